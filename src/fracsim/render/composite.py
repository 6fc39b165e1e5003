"""Front-to-back compositing of a feature vector of any width in one pass over the pixels."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.camera import TILE
from fracsim.render.project import LOG_FLOOR

# Constants of the original 3DGS (Kerbl et al. 2023).
ALPHA_CAP = 0.99
"""Largest alpha of one Gaussian at a pixel."""
STOP = 1e-4
"""Lowest transmittance of a pixel. The first Gaussian that would fall below it is left out, and the pixel is done."""


@ti.func
def pixels(low, high, first, end):
    """First and end of the pixels among first, ..., end - 1 with centres in [low, high] [px], rounded outwards."""
    # Clamped before the cast: the bounds of a huge Gaussian exceed an int32.
    start, stop = ti.max(ti.ceil(low - 0.501), first), ti.min(ti.floor(high - 0.499) + 1, end)
    return ti.cast(start, ti.i32), ti.cast(stop, ti.i32)


@cache
def compositor(channels: int, block: int, dtype: Any) -> Any:
    """The kernel that sums feature_i alpha_i prod_{j < i} (1 - alpha_j) over each pixel's Gaussians, nearest first.

    A thread takes block x block pixels of one tile and visits only those that a Gaussian covers. It ends when all its
    pixels are done. Whole tiles suit a CPU, single pixels a GPU. No background is blended in.
    """
    feature = ti.types.vector(channels, dtype)

    @ti.kernel
    def composite(
        starts: ti.types.ndarray(dtype=ti.i32, ndim=1),  # first entry of each tile, (tiles + 1,)
        entries: ti.types.ndarray(dtype=ti.i32, ndim=1),  # Gaussians of the tiles, nearest first, (entries,)
        ellipse: ti.types.ndarray(dtype=ti.types.vector(8, dtype), ndim=1),  # see `projector`, (N,)
        depth: ti.types.ndarray(dtype=dtype, ndim=1),  # [m], (N,)
        features: ti.types.ndarray(dtype=feature, ndim=1),  # (N,)
        image: ti.types.ndarray(dtype=feature, ndim=2),  # in: zero, (H, W)
        transmittance: ti.types.ndarray(dtype=dtype, ndim=2),  # in: one; out: negative where done, (H, W)
        median: ti.types.ndarray(dtype=dtype, ndim=2),  # in: infinite; out: depth of transmittance 1/2 [m], (H, W)
    ):
        # Pixels in the order of tiles and blocks: on a CPU 512 consecutive ones stay on one thread.
        for p in range(image.shape[0] * image.shape[1]):
            if p % (block * block) == 0:
                tile, inside = p // (TILE * TILE), p % (TILE * TILE) // (block * block)
                top = tile // (image.shape[1] // TILE) * TILE + inside // (TILE // block) * block
                left = tile % (image.shape[1] // TILE) * TILE + inside % (TILE // block) * block
                k, end, alive = starts[tile], starts[tile + 1], block * block
                while k < end and alive > 0:
                    g = entries[k]
                    x, y, a, b, c, peak, half_x, half_y = ellipse[g]
                    value = features[g]
                    top_g, bottom_g = pixels(y - half_y, y + half_y, top, top + block)
                    left_g, right_g = pixels(x - half_x, x + half_x, left, left + block)
                    for row in range(top_g, bottom_g):
                        v = row + dtype(0.5) - y
                        for column in range(left_g, right_g):
                            u = column + dtype(0.5) - x
                            q = peak + c * v * v + (a * u + b * v) * u
                            T = transmittance[row, column]
                            if T > 0 and q >= dtype(LOG_FLOOR):
                                alpha = ti.min(ti.exp(q), dtype(ALPHA_CAP))
                                T_next = T * (1 - alpha)
                                if T_next < dtype(STOP):
                                    transmittance[row, column] = -T
                                    alive -= 1
                                else:
                                    image[row, column] = image[row, column] + T * alpha * value
                                    transmittance[row, column] = T_next
                                    if T_next < dtype(0.5) <= T:
                                        median[row, column] = depth[g]
                    k += 1

    return composite
