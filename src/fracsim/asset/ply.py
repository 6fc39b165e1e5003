"""Trained 3DGS checkpoints, point_cloud.ply in the layout of Kerbl et al. 2023 (INRIA), read and written.

A vertex has x y z, nx ny nz (unused), f_dc_0..2, f_rest_* (channel by channel, absent at SH degree 0), opacity (a
logit), scale_0..2 (logarithms of standard deviations) and rot_0..3 (a quaternion w x y z of any length). Files that
lack scale_2 hold discs (2DGS). Infinite logits and logarithms of minus infinity are exact ends: opaque, flat.
"""

from pathlib import Path
from typing import Any

import numpy as np
import plyfile
from scipy.spatial.transform import Rotation

from fracsim.asset import stored, supersplat
from fracsim.asset.cloud import Gaussians, Rows, gaussians
from fracsim.asset.gaussians import SH_C0
from fracsim.records import Array

NEEDED = ("x", "y", "z", "opacity", *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4)))
COLOURS = tuple(f"f_dc_{i}" for i in range(3))
BYTES = ("red", "green", "blue")
"""Colours of files that have no f_dc."""
DEGREES = {0: 0, 9: 1, 24: 2, 45: 3}
"""SH degree by the number of f_rest properties."""
UPPER = tuple(zip(*np.triu_indices(3), strict=True))


def read(path: str | Path) -> Gaussians:
    """The Gaussians of a checkpoint, compressed ones included; raises ValueError, with asset.path, for another file."""
    elements = _elements(path)
    vertex = elements["vertex"]
    names = {p.name for p in vertex.properties}
    if supersplat.PACKED[0] in names:
        return supersplat.read(path, elements)
    names |= {"scale_2"}  # discs (2DGS) have two scales
    constant = COLOURS if names.issuperset(COLOURS) or not names.issuperset(BYTES) else BYTES
    _check_names(path, names, constant)
    rest = [f"f_rest_{i}" for i in range(len([n for n in names if n.startswith("f_rest_")]))]
    if len(rest) not in DEGREES or not names.issuperset(rest):
        raise ValueError(
            f"asset.path={path} has {len(rest)} properties f_rest_*, a checkpoint has 0, 9, 24 or 45 of them, "
            "numbered from 0 (SH degree 0 to 3): export it again."
        )
    columns = {p.name: vertex[p.name] for p in vertex.properties}
    columns.setdefault("scale_2", np.full(vertex.count, -np.inf))
    values = {n: np.asarray(columns[n], np.float64) for n in (*NEEDED, *constant, *rest)}
    sh = np.stack([values[n] for n in constant], axis=1)[:, None, :]
    if constant is BYTES:
        sh = (sh / (255 if vertex[BYTES[0]].dtype.kind in "iu" else 1) - 0.5) / SH_C0
    higher = np.stack([values[n] for n in rest], axis=1).reshape(len(sh), 3, -1).transpose(0, 2, 1) if rest else None
    means = np.stack([values[n] for n in "xyz"], axis=1)
    deviations, linear_scales = stored.deviations(np.stack([values[f"scale_{i}"] for i in range(3)], axis=1), means)
    opacity, linear_opacities = stored.opacities(values["opacity"])
    rows = Rows(
        means=means,
        deviations=deviations,
        quaternion=np.stack([values[f"rot_{i}"] for i in range(4)], axis=1),
        opacity=opacity,
        sh=sh if higher is None else np.concatenate([sh, higher], axis=1),
    )
    return gaussians(path, rows, (*linear_scales, *linear_opacities))


def _elements(path: str | Path) -> dict[str, Any]:
    """The elements of a PLY file with vertices; raises ValueError if it is none."""
    try:
        file = plyfile.PlyData.read(str(path))
    except (plyfile.PlyParseError, OSError, ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"asset.path={path} cannot be read as PLY ({error}): give a whole point_cloud.ply.") from error
    elements = {e.name: e for e in file.elements}
    if "vertex" not in elements or elements["vertex"].count == 0:
        raise ValueError(f"asset.path={path} has no vertices: give the point_cloud.ply of a trained 3DGS model.")
    return elements


def _check_names(path: str | Path, names: set[str], constant: tuple[str, ...]) -> None:
    """Raises ValueError unless the properties `names` have all that a Gaussian needs."""
    missing = [n for n in (*NEEDED[:3], *constant, *NEEDED[3:]) if n not in names]
    if missing:
        raise ValueError(
            f"asset.path={path} is not a 3DGS checkpoint, it lacks the properties {', '.join(missing)}: give a "
            "point_cloud.ply in the INRIA layout, or load a surface mesh by asset.kind=mesh."
        )


def symmetric(covariance: Array) -> Array:
    """Symmetric matrices (N, 3, 3) of their entries xx, xy, xz, yy, yz, zz, (N, 6)."""
    out = np.empty((len(covariance), 3, 3), covariance.dtype)
    for k, (i, j) in enumerate(UPPER):
        out[:, i, j] = out[:, j, i] = covariance[:, k]
    return out


def triangle(matrices: Array) -> Array:
    """The entries xx, xy, xz, yy, yz, zz, (N, 6), of symmetric matrices (N, 3, 3)."""
    return np.stack([matrices[:, i, j] for i, j in UPPER], axis=1)


def write(path: str | Path, means: Array, covariance: Array, opacity: Array, sh: Array) -> None:
    """Writes a checkpoint of means (N, 3), covariance (N, 6), opacity (N,) in [0, 1] and sh (N, K, 3).

    Binary, little-endian, float32. Opacities are clamped to 1e-6 from 0 and 1, since the logit is infinite there.
    Variances are at least 1e-14 of the Gaussian's largest, since rounding may make smaller ones negative.
    """
    variances, axes = np.linalg.eigh(symmetric(np.asarray(covariance, np.float64)))
    axes[np.linalg.det(axes) < 0, :, 0] *= -1
    variances = np.maximum(variances, 1e-14 * variances[:, 2:] + 1e-30)
    p = np.clip(np.asarray(opacity, np.float64), 1e-6, 1 - 1e-6)
    columns: dict[str, Array] = dict(zip("xyz", np.asarray(means).T, strict=True))
    columns |= {n: np.zeros(len(p)) for n in ("nx", "ny", "nz")}
    columns |= {f"f_dc_{i}": sh[:, 0, i] for i in range(3)}
    columns |= {f"f_rest_{i}": c for i, c in enumerate(sh[:, 1:].transpose(0, 2, 1).reshape(len(p), -1).T)}
    columns |= {"opacity": np.log(p / (1 - p))}
    columns |= {f"scale_{i}": 0.5 * np.log(variances[:, i]) for i in range(3)}
    quaternion = Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]]
    columns |= {f"rot_{i}": quaternion[:, i] for i in range(4)}
    vertex = np.empty(len(p), [(n, "<f4") for n in columns])
    for name, column in columns.items():
        vertex[name] = column
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")], byte_order="<").write(str(path))
