"""EWA projection of deformed Gaussians to image ellipses (Zwicker et al. 2001, constants of Kerbl et al. 2023)."""

from functools import cache
from math import log
from typing import Any

import taichi as ti

from fracsim.render.camera import NEAR, TILE

LOW_PASS = 0.3
"""Variance added to every image covariance [px^2]."""
ALPHA_FLOOR = 1 / 255
"""A Gaussian ends where its alpha falls below this."""
LOG_FLOOR = log(ALPHA_FLOOR)
WIDEN = 1.3
"""Half fields of view beyond which the Jacobian no longer follows the centre."""


@ti.func
def affine(t, fx, fy, low, high):
    """Rows of the projection's Jacobian at camera point t, its tangents held in [low, high] (EWA, eq. 29)."""
    u = ti.math.clamp(t[0] / t[2], low[0], high[0])
    v = ti.math.clamp(t[1] / t[2], low[1], high[1])
    return ti.Matrix([[fx / t[2], 0 * u, -fx * u / t[2]], [0 * v, fy / t[2], -fy * v / t[2]]])


@ti.func
def finite(x):
    """Whether x is a number; by its bits, as fast math may assume that comparisons never see a NaN."""
    return not (ti.math.isnan(x) or ti.math.isinf(x))


@ti.func
def tiles_over(centre, half, size):
    """First tile and one past the last, on an axis of `size` px, that [centre - half, centre + half] meets."""
    count = size / TILE
    # Clamped before the cast: a huge radius has no int32. The margin keeps rounding from losing an edge pixel.
    low = ti.math.clamp(ti.floor((centre - half) / TILE - 1e-3), 0, count)
    high = ti.math.clamp(ti.floor((centre + half) / TILE + 1e-3) + 1, 0, count)
    return ti.cast(low, ti.i32), ti.cast(high, ti.i32)


@cache
def projector(dtype: Any) -> Any:
    """The kernel that writes each Gaussian's depth, tile rectangle and image ellipse.

    A Gaussian is left out (an empty rectangle) nearer than NEAR, outside the picture, nowhere above ALPHA_FLOOR, or
    degenerate (not finite, determinant not positive). Its alpha at the offset (dx, dy) [px] from its image centre is
    exp(q) with q = ellipse[5] + ellipse[2] dx^2 + ellipse[3] dx dy + ellipse[4] dy^2.
    """

    @ti.kernel
    def project(
        means: ti.types.ndarray(dtype=dtype, ndim=2),  # [N, 3] world [m]
        covariance: ti.types.ndarray(dtype=dtype, ndim=2),  # [N, 6] at rest: xx xy xz yy yz zz [m^2]
        F: ti.types.ndarray(dtype=dtype, ndim=3),  # [N, 3, 3] deformation gradients
        opacity: ti.types.ndarray(dtype=dtype, ndim=1),  # [N]
        pose: ti.types.ndarray(dtype=dtype, ndim=2),  # [4, 4] world to camera
        lens: ti.types.ndarray(dtype=dtype, ndim=1),  # [6] fx fy cx cy width height [px]
        depth: ti.types.ndarray(dtype=dtype, ndim=1),  # [N] out [m], 0 where left out
        rectangle: ti.types.ndarray(dtype=ti.i32, ndim=2),  # [N, 4] out: first x, first y, end x, end y [tiles]
        ellipse: ti.types.ndarray(dtype=dtype, ndim=2),  # [N, 8] out: x, y [px], q of dx^2, dx dy, dy^2, 1, half w, half h [px]
    ):
        for g in range(means.shape[0]):
            W = ti.Matrix([[pose[i, j] for j in range(3)] for i in range(3)])
            x = ti.Vector([means[g, 0], means[g, 1], means[g, 2]])
            t = W @ x + ti.Vector([pose[0, 3], pose[1, 3], pose[2, 3]])
            focal, axis = ti.Vector([lens[0], lens[1]]), ti.Vector([lens[2], lens[3]])
            size = ti.Vector([lens[4], lens[5]])
            beyond = dtype((WIDEN - 1) / 2) * size
            centre = focal * ti.Vector([t[0], t[1]]) / t[2] + axis

            a = ti.Vector([covariance[g, i] for i in range(6)])
            A = ti.Matrix([[a[0], a[1], a[2]], [a[1], a[3], a[4]], [a[2], a[4], a[5]]])
            M = affine(t, lens[0], lens[1], -(axis + beyond) / focal, (size - axis + beyond) / focal) @ W
            M = M @ ti.Matrix([[F[g, i, j] for j in range(3)] for i in range(3)])
            S = M @ A @ M.transpose() + ti.Matrix([[LOW_PASS, 0], [0, LOW_PASS]])
            det = S[0, 0] * S[1, 1] - S[0, 1] * S[0, 1]

            depth[g] = 0
            for i in ti.static(range(4)):
                rectangle[g, i] = 0
            sound = finite(S.sum() + det + centre.sum() + opacity[g])
            if sound and t[2] > dtype(NEAR) and det > 0 and opacity[g] > dtype(ALPHA_FLOOR):
                peak = ti.log(opacity[g])
                reach = 2 * (peak - dtype(LOG_FLOOR))  # Mahalanobis distance squared where alpha ends
                half = ti.Vector([ti.sqrt(reach * S[0, 0]), ti.sqrt(reach * S[1, 1])])
                x0, x1 = tiles_over(centre[0], half[0], size[0])
                y0, y1 = tiles_over(centre[1], half[1], size[1])
                if x0 < x1 and y0 < y1:
                    depth[g] = t[2]
                    rectangle[g, 0], rectangle[g, 1], rectangle[g, 2], rectangle[g, 3] = x0, y0, x1, y1
                    ellipse[g, 0], ellipse[g, 1], ellipse[g, 5] = centre[0], centre[1], peak
                    ellipse[g, 2] = -S[1, 1] / (2 * det)
                    ellipse[g, 3] = S[0, 1] / det
                    ellipse[g, 4] = -S[0, 0] / (2 * det)
                    ellipse[g, 6], ellipse[g, 7] = half[0], half[1]

    return project
