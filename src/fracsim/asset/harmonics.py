"""Rotation of the view-dependent colour of a Gaussian: spherical harmonics in the order and signs of 3DGS."""

import numpy as np

from fracsim.records import Array

BANDS = [slice(degree**2, (degree + 1) ** 2) for degree in range(4)]
"""Slice of the coefficients of each degree."""
BLOCK = 10_000
"""Gaussians rotated at a time: bounds the memory."""


def basis(directions: Array) -> Array:
    """The 16 real spherical harmonics of degree 0 to 3, (M, 16), in unit directions (M, 3)."""
    x, y, z = directions.T
    a, b, c = np.sqrt(np.array([1, 3, 15]) / (4 * np.pi))
    d, e, f, g = np.sqrt(np.array([5 / 16, 35 / 32, 21 / 32, 7 / 16]) / np.pi)
    h = np.sqrt(105 / (4 * np.pi))
    columns = [
        a + 0 * x,
        -b * y, b * z, -b * x,
        c * x * y, -c * y * z, d * (3 * z * z - 1), -c * x * z, c / 2 * (x * x - y * y),
        -e * y * (3 * x * x - y * y), h * x * y * z, -f * y * (5 * z * z - 1), g * z * (5 * z * z - 3),
        -f * x * (5 * z * z - 1), h / 2 * z * (x * x - y * y), -e * x * (x * x - 3 * y * y),
    ]  # fmt: skip
    return np.stack(columns, axis=1)


def turned(sh: Array, R: Array) -> Array:
    """Coefficients (N, K, 3) of the colours `sh` (N, K, 3) of objects turned by R, (3, 3) or (N, 3, 3).

    f'(d) = f(R^T d). A rotation mixes only coefficients of the same degree (Wigner 1931). The matrix of each degree is
    a least-squares fit in 24 directions, so it is exact.
    """
    directions = np.random.default_rng(0).normal(size=(24, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    fits = [np.linalg.pinv(basis(directions)[:, band]) for band in BANDS]
    out: Array = sh.copy()
    for some in (slice(i, i + BLOCK) for i in range(0, len(sh), BLOCK)):
        turns = R[None] if R.ndim == 2 else R[some]
        old = basis((directions @ turns).reshape(-1, 3)).reshape(len(turns), len(directions), 16)
        for band, fit in zip(BANDS[: int(np.sqrt(sh.shape[1]))], fits, strict=False):
            out[some, band] = (fit @ old[:, :, band]) @ sh[some, band]
    return out
