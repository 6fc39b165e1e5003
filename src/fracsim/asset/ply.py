"""Trained 3DGS checkpoints, point_cloud.ply in the layout of Kerbl et al. 2023 (INRIA), read and written.

A vertex has x y z, nx ny nz (unused), f_dc_0..2, f_rest_* (channel by channel, absent at SH degree 0), opacity (a
logit), scale_0..2 (logarithms of standard deviations) and rot_0..3 (a quaternion w x y z of any length).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import plyfile
from scipy.spatial.transform import Rotation

from fracsim.records import Array

NEEDED = ("x", "y", "z", *(f"f_dc_{i}" for i in range(3)), "opacity", *(f"scale_{i}" for i in range(3)),
          *(f"rot_{i}" for i in range(4)))  # fmt: skip
DEGREES = {0: 0, 9: 1, 24: 2, 45: 3}
"""SH degree by the number of f_rest properties."""
UPPER = tuple(zip(*np.triu_indices(3), strict=True))


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians of a checkpoint, in its own coordinates."""

    means: Array
    """Centres, (N, 3) float64."""
    covariance: Array
    """Covariances, (N, 3, 3) float64."""
    opacity: Array
    """Opacities in [0, 1], (N,)."""
    sh: Array
    """Coefficients, (N, K, 3), K = 1, 4, 9 or 16."""


def read(path: str | Path) -> Gaussians:
    """The Gaussians of a checkpoint; raises ValueError, with asset.path, for another file."""
    vertex = _vertex(path)
    names = {p.name for p in vertex.properties}
    rest = [f"f_rest_{i}" for i in range(len([n for n in names if n.startswith("f_rest_")]))]
    if len(rest) not in DEGREES or not names.issuperset(rest):
        raise ValueError(
            f"asset.path={path} has {len(rest)} properties f_rest_*, a checkpoint has 0, 9, 24 or 45 of them, "
            "numbered from 0 (SH degree 0 to 3): export it again."
        )
    values = {n: np.asarray(vertex[n], np.float64) for n in (*NEEDED, *rest)}
    _check_values(path, values)
    R = _rotations(np.stack([values[f"rot_{i}"] for i in range(4)], axis=1))
    deviations = np.exp(np.stack([values[f"scale_{i}"] for i in range(3)], axis=1))
    constant = np.stack([values[f"f_dc_{i}"] for i in range(3)], axis=1)[:, None, :]
    higher = np.stack([values[n] for n in rest], axis=1).reshape(len(R), 3, -1).transpose(0, 2, 1) if rest else None
    return Gaussians(
        means=np.stack([values[n] for n in "xyz"], axis=1),
        covariance=np.einsum("nij,nj,nkj->nik", R, deviations**2, R),
        opacity=1 / (1 + np.exp(-np.clip(values["opacity"], -50, 50))),
        sh=constant if higher is None else np.concatenate([constant, higher], axis=1),
    )


def _vertex(path: str | Path) -> Any:
    """The vertex element of a PLY file; raises ValueError if it is not that of a checkpoint."""
    try:
        file = plyfile.PlyData.read(str(path))
    except (plyfile.PlyParseError, OSError, ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"asset.path={path} cannot be read as PLY ({error}): give a whole point_cloud.ply.") from error
    vertex = next((e for e in file.elements if e.name == "vertex"), None)
    if vertex is None or vertex.count == 0:
        raise ValueError(f"asset.path={path} has no vertices: give the point_cloud.ply of a trained 3DGS model.")
    missing = [n for n in NEEDED if n not in {p.name for p in vertex.properties}]
    if missing:
        raise ValueError(
            f"asset.path={path} is not a 3DGS checkpoint, it lacks the properties {', '.join(missing)}: give a "
            "point_cloud.ply in the INRIA layout, or load a surface mesh by asset.kind=mesh."
        )
    return vertex


def _check_values(path: str | Path, values: dict[str, Array]) -> None:
    """Raises ValueError for the first of the properties `values`, (N,) each, with an unusable value."""
    for name, column in values.items():
        bad = ~np.isfinite(column)
        if name.startswith("scale_"):
            bad |= column > 50  # a deviation of 5e21: the file holds something else
        if bad.any():
            raise ValueError(
                f"asset.path={path}: property {name} of vertex {int(np.argmax(bad))} is {column[np.argmax(bad)]:g} "
                f"({int(bad.sum())} such vertices): remove them, or export the checkpoint again."
            )


def _rotations(q: Array) -> Array:
    """Rotation matrices (N, 3, 3) of quaternions w x y z (N, 4); a zero quaternion is the identity."""
    q = np.where(np.linalg.norm(q, axis=1, keepdims=True) > 1e-12, q, (1.0, 0.0, 0.0, 0.0))
    R: Array = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
    return R


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
