"""Gaussians of a file, whatever its format: checked, and as means, covariances, opacities and colours."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from fracsim.records import Array

WIDEST = 5e21
"""Standard deviations above this are no sizes: the file holds something else."""
TOLERATED = 0.5
"""Files with a larger share of rows that cannot be used are refused."""

WORDS = {"means": "position", "deviations": "deviation", "quaternion": "rotation", "opacity": "opacity", "sh": "colour"}


@dataclass(frozen=True)
class Gaussians:
    """N Gaussians of a file, in its own coordinates."""

    means: Array
    """Centres, (N, 3) float64."""
    covariance: Array
    """Covariances, (N, 3, 3) float64."""
    opacity: Array
    """Opacities in [0, 1], (N,)."""
    sh: Array
    """Coefficients, (N, K, 3), K = 1, 4, 9 or 16."""
    notes: tuple[str, ...] = ()
    """Notes for the user about the file."""


@dataclass(frozen=True)
class Rows:
    """N rows of a file with its codes undone."""

    means: Array
    """Centres, (N, 3)."""
    deviations: Array
    """Standard deviations along the axes, (N, 3); 0 is flat."""
    quaternion: Array
    """Rotations w x y z of any length, (N, 4)."""
    opacity: Array
    """Opacities in [0, 1], (N,)."""
    sh: Array
    """Coefficients, (N, K, 3)."""


def gaussians(path: str | Path, rows: Rows, notes: tuple[str, ...] = ()) -> Gaussians:
    """The Gaussians of the rows that can be used; a note counts the others.

    Raises ValueError, with asset.path, if more than TOLERATED of the rows cannot be used.
    """
    bad, first = _unusable(rows)
    if bad.mean() > TOLERATED:
        raise ValueError(
            f"asset.path={path}: {first} ({int(bad.sum())} of {len(bad)} Gaussians are such): "
            "export the checkpoint again."
        )
    if bad.any():
        notes = (
            *notes,
            f"{int(bad.sum())} of {len(bad)} Gaussians were dropped, their values are no numbers: {first}.",
        )
        rows = Rows(*(a[~bad] for a in (rows.means, rows.deviations, rows.quaternion, rows.opacity, rows.sh)))
    R = _rotations(rows.quaternion)
    covariance = np.einsum("nij,nj,nkj->nik", R, rows.deviations**2, R)
    return Gaussians(rows.means, covariance, rows.opacity, rows.sh, notes)


def _unusable(rows: Rows) -> tuple[Array, str]:
    """Whether a row cannot be used, (N,) bool, and the first of them in words."""
    bad, first = np.zeros(len(rows.means), bool), ""
    for name, values in vars(rows).items():
        wrong = ~np.isfinite(values)
        if name == "deviations":
            wrong |= values > WIDEST
        here = wrong.reshape(len(bad), -1).any(axis=1)
        if here.any() and not first:
            at = int(np.argmax(here))
            first = f"{WORDS[name]} of vertex {at} is {', '.join(f'{v:g}' for v in np.ravel(values[at])[:4])}"
        bad |= here
    return bad, first


def _rotations(q: Array) -> Array:
    """Rotation matrices (N, 3, 3) of quaternions w x y z (N, 4); a zero quaternion is the identity."""
    q = np.where(np.linalg.norm(q, axis=1, keepdims=True) > 1e-12, q, (1.0, 0.0, 0.0, 0.0))
    R: Array = Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix()
    return R
