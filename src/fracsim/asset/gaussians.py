"""The Gaussian of each material point: flat along the surface, round inside, its colour as SH degree 0."""

import numpy as np

from fracsim.asset.fill import SKIN, Filling
from fracsim.records import Array, Particles

SH_C0 = 0.28209479177387814  # 1 / sqrt(4 pi): the constant spherical harmonic
TANGENTIAL, NORMAL = 0.6, 0.16
"""Standard deviations of surface Gaussians along and across the surface [particle spacings]."""
ROUND = 0.6
"""Standard deviation of interior Gaussians [particle spacings]; less where it would reach through the surface."""
OPACITY = 0.98


def particles(filling: Filling, rgb: Array, spacing: float, notes: tuple[str, ...] = ()) -> Particles:
    """Particles of a filling with colours `rgb` (N, 3), sRGB in [0, 1]. The filling's notes follow `notes`."""
    return Particles(
        X=filling.X.astype(np.float32),
        volume=filling.volume.astype(np.float32),
        covariance=covariance(filling, spacing).astype(np.float32),
        opacity=np.full(len(filling.X), OPACITY, np.float32),
        sh=constant_sh(rgb),
        surface=filling.surface,
        spacing=spacing,
        notes=(*notes, *filling.notes),
    )


def constant_sh(rgb: Array) -> Array:
    """Coefficients (N, 1, 3) float32 of colours (N, 3) that are the same from all directions."""
    return ((np.asarray(rgb, np.float64) - 0.5) / SH_C0).astype(np.float32)[:, None, :]


def covariance(filling: Filling, spacing: float) -> Array:
    """Covariances (N, 6) as xx, xy, xz, yy, yz, zz [m^2]: t^2 I + (n^2 - t^2) N N^T with the outward normal N."""
    t = np.full(len(filling.X), TANGENTIAL * spacing)
    deep = ~filling.surface
    # Half the depth, so that the surface is two standard deviations away.
    t[deep] = np.clip(0.5 * filling.depth[deep], 0.4 * spacing, ROUND * spacing)
    rows, columns = np.triu_indices(3)
    n = NORMAL * spacing
    flat: Array = (n * n - t * t)[:, None] * filling.normal[:, rows] * filling.normal[:, columns]
    flat[:, rows == columns] += (t * t)[:, None]
    return flat


def lifted(filling: Filling, spacing: float) -> tuple[Array, Array]:
    """Points (N, 3) [m] and depths (N,) [m] whose colours the particles take.

    A surface particle takes the colour of the surface right above it.
    """
    P = filling.X + SKIN * spacing * filling.normal
    return P, np.where(filling.surface, 0.0, filling.depth)


def footprint(P: Array, normal: Array, spacing: float) -> Array:
    """Five points (5, N, 3) that a surface particle at P (N, 3) with normal (N, 3) covers.

    The mean of their colours does not alias.
    """
    helper = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    u = np.cross(normal, helper)
    u *= 0.35 * spacing / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    v = np.cross(normal, u)
    return np.stack([P, P + u, P - u, P + v, P - v])
