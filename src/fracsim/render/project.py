"""EWA projection of deformed Gaussians to ellipses in the image (Zwicker et al. 2001)."""

from functools import cache
from math import log
from typing import Any

import taichi as ti

from fracsim.camera import TILE

# Constants of the original 3DGS (Kerbl et al. 2023).
LOW_PASS = 0.3
"""Variance added to every image covariance [px^2]."""
LOG_FLOOR = log(1 / 255)
"""Smallest logarithm of alpha that is composited."""
WIDEN = 0.3
"""The Jacobian is evaluated at the Gaussian's centre, clamped to 1 + WIDEN times the half field of view."""


@ti.func
def jacobian(t, focal, low, high):
    """Derivative, (2, 3), of the image position [px] by the camera position t [m], (3,).

    The tangents t_x / t_z and t_y / t_z are clamped to [low, high], (2,) each.
    """
    u = ti.math.clamp(t[0] / t[2], low[0], high[0])
    v = ti.math.clamp(t[1] / t[2], low[1], high[1])
    return ti.Matrix([[focal[0], 0, -focal[0] * u], [0, focal[1], -focal[1] * v]]) / t[2]


@ti.func
def finite(x):
    """Whether x is finite, by its bits: fast math lets the compiler assume that no comparison meets NaN."""
    return not (ti.math.isnan(x) or ti.math.isinf(x))


@ti.func
def tiles_over(low, high, count):
    """First x, y and end x, y, (4,), of the tiles that meet the box from low to high [px], (2,) each.

    There are `count`, (2,), tiles along x and y.
    """
    # Clamped before the cast: a huge radius exceeds an int32. The margin keeps rounding from losing an edge pixel.
    first = ti.math.clamp(ti.floor(low / TILE - 1e-3), 0, count)
    end = ti.math.clamp(ti.floor(high / TILE + 1e-3) + 1, 0, count)
    return ti.cast(ti.Vector([first[0], first[1], end[0], end[1]]), ti.i32)


@cache
def projector(dtype: Any) -> Any:
    """The kernel that writes each Gaussian's depth, key of the order, tile rectangle and image ellipse.

    With (x, y, a, b, c, peak, half width, half height) = ellipse, alpha at (x + u, y + v) [px] is the exponential of
    peak + a u^2 + b u v + c v^2. It reaches 1/255 only within the half sizes. A Gaussian gets an empty rectangle if it
    is nearer than `near`, outside the image, nowhere above 1/255, not finite, or has a covariance whose determinant is
    not positive. Its key is the depth plus `tilt` times its position to the right and down, see `Splatter`.
    """
    real2, real3, real6, real8 = (ti.types.vector(n, dtype) for n in (2, 3, 6, 8))
    real33 = ti.types.matrix(3, 3, dtype)

    @ti.kernel
    def project(
        means: ti.types.ndarray(dtype=real3, ndim=1),  # world [m], (N,)
        covariance: ti.types.ndarray(dtype=real6, ndim=1),  # at rest: xx xy xz yy yz zz [m^2], (N,)
        F: ti.types.ndarray(dtype=real33, ndim=1),  # deformation gradients, (N,)
        opacity: ti.types.ndarray(dtype=dtype, ndim=1),  # (N,)
        R: real33,  # rotation from world to camera
        shift: real3,  # translation from world to camera [m]
        focal: real2,  # fx, fy [px]
        axis: real2,  # cx, cy [px]
        size: real2,  # width, height [px]
        near: dtype,  # depth up to which Gaussians are left out [m]
        tilt: real2,  # right, down
        depth: ti.types.ndarray(dtype=dtype, ndim=1),  # out: [m], 0 where left out, (N,)
        key: ti.types.ndarray(dtype=dtype, ndim=1),  # out: sorts [m], 0 where left out, (N,)
        rectangle: ti.types.ndarray(dtype=ti.types.vector(4, ti.i32), ndim=1),  # out: first, end tile (x, y), (N,)
        ellipse: ti.types.ndarray(dtype=real8, ndim=1),  # out: see above, (N,)
    ):
        for g in range(means.shape[0]):
            t = R @ means[g] + shift
            centre = focal * t.xy / t[2] + axis
            beyond = size * dtype(WIDEN / 2)
            s = covariance[g]
            A = ti.Matrix([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])
            J = jacobian(t, focal, (-axis - beyond) / focal, (size - axis + beyond) / focal) @ R @ F[g]
            S = J @ A @ J.transpose()
            xx, xy, yy = S[0, 0] + dtype(LOW_PASS), S[0, 1], S[1, 1] + dtype(LOW_PASS)
            det = xx * yy - xy * xy
            peak = ti.log(opacity[g])
            reach = 2 * (peak - dtype(LOG_FLOOR))  # squared Mahalanobis distance at which alpha is 1/255

            depth[g] = 0
            key[g] = 0
            rectangle[g] = 0
            if finite(xx + yy + det + centre.sum() + reach) and t[2] > near and det > 0 and reach > 0:
                half = ti.sqrt(reach * ti.Vector([xx, yy]))
                box = tiles_over(centre - half, centre + half, size / TILE)
                if box[0] < box[2] and box[1] < box[3]:
                    depth[g] = t[2]
                    key[g] = ti.max(t[2] + tilt.dot(t.xy), 0)
                    rectangle[g] = box
                    a, b, c = -yy / (2 * det), xy / det, -xx / (2 * det)
                    ellipse[g] = ti.Vector([centre.x, centre.y, a, b, c, peak, half.x, half.y])

    return project
