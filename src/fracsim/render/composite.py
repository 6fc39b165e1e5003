"""Front-to-back compositing of a feature vector of any width in one pass over the pixels."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.render.camera import TILE
from fracsim.render.project import LOG_FLOOR

ALPHA_CAP = 0.99
"""Largest alpha of one Gaussian at a pixel."""
STOP = 1e-4
"""A pixel is done before the Gaussian that would bring its transmittance below this."""


@cache
def compositor(channels: int, dtype: Any) -> Any:
    """The kernel that sums features alpha_i prod_{j < i} (1 - alpha_j) over each pixel's Gaussians, nearest first.

    Constants and stopping rule of Kerbl et al. 2023; no background is blended in. One thread a pixel, pixels in the
    order of tiles: neighbours read the same list.
    """

    @ti.kernel
    def composite(
        starts: ti.types.ndarray(dtype=ti.i32, ndim=1),  # [tiles + 1] where a tile's entries start
        entries: ti.types.ndarray(dtype=ti.i32, ndim=1),  # [P] Gaussians, nearest first
        ellipse: ti.types.ndarray(dtype=dtype, ndim=2),  # [N, 8] see projector
        depth: ti.types.ndarray(dtype=dtype, ndim=1),  # [N] [m]
        features: ti.types.ndarray(dtype=dtype, ndim=2),  # [N, channels]
        image: ti.types.ndarray(dtype=dtype, ndim=3),  # [H, W, channels] out
        alpha: ti.types.ndarray(dtype=dtype, ndim=2),  # [H, W] out
        median: ti.types.ndarray(dtype=dtype, ndim=2),  # [H, W] in: infinite; out: depth of transmittance 1/2 [m]
    ):
        for p in range(alpha.shape[0] * alpha.shape[1]):
            tile = p // (TILE * TILE)
            tiles_x = alpha.shape[1] // TILE
            row = tile // tiles_x * TILE + p // TILE % TILE
            column = tile % tiles_x * TILE + p % TILE
            x, y = column + dtype(0.5), row + dtype(0.5)
            total = ti.Vector.zero(dtype, channels)
            T = dtype(1.0)
            k = starts[tile]
            end = starts[tile + 1]
            while k < end:
                g = entries[k]
                k += 1
                dx, dy = x - ellipse[g, 0], y - ellipse[g, 1]
                q = ellipse[g, 5] + (ellipse[g, 2] * dx + ellipse[g, 3] * dy) * dx + ellipse[g, 4] * dy * dy
                if q >= dtype(LOG_FLOOR):
                    a = ti.min(ti.exp(q), dtype(ALPHA_CAP))
                    T_next = T * (1 - a)
                    if T_next < dtype(STOP):
                        break
                    for c in ti.static(range(channels)):
                        total[c] += T * a * features[g, c]
                    if T >= dtype(0.5) and T_next < dtype(0.5):
                        median[row, column] = depth[g]
                    T = T_next
            for c in ti.static(range(channels)):
                image[row, column, c] = total[c]
            alpha[row, column] = 1 - T

    return composite
