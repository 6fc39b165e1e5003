"""The kernel that finds the visible Gaussians of an image."""

import taichi as ti

from fracsim.camera import TILE
from fracsim.render.composite import ALPHA_CAP, STOP, pixels
from fracsim.render.project import LOG_FLOOR


@ti.kernel
def mark_visible(
    starts: ti.types.ndarray(dtype=ti.i32, ndim=1),  # first entry of each tile, (tiles + 1,)
    entries: ti.types.ndarray(dtype=ti.i32, ndim=1),  # Gaussians of the tiles, nearest first, (entries,)
    ellipse: ti.types.ndarray(dtype=ti.types.vector(8, ti.f32), ndim=1),  # (N,)
    transmittance: ti.types.ndarray(dtype=ti.f32, ndim=2),  # in: 1; out: 0 where done, (H, W)
    marks: ti.types.ndarray(dtype=ti.i32, ndim=1),  # in: 0; out: 1 for a Gaussian that contributes to a pixel, (N,)
):
    """The loop of `fracsim.render.composite` over whole tiles, without features."""
    columns = transmittance.shape[1] // TILE
    for tile in range(starts.shape[0] - 1):
        top, left = tile // columns * TILE, tile % columns * TILE
        for k in range(starts[tile], starts[tile + 1]):
            g = entries[k]
            x, y, a, b, c, peak, half_x, half_y = ellipse[g]
            top_g, bottom_g = pixels(y - half_y, y + half_y, top, top + TILE)
            left_g, right_g = pixels(x - half_x, x + half_x, left, left + TILE)
            for row, column in ti.ndrange((top_g, bottom_g), (left_g, right_g)):
                u, v, T = column + 0.5 - x, row + 0.5 - y, transmittance[row, column]
                q = peak + c * v * v + (a * u + b * v) * u
                if T > 0 and q >= LOG_FLOOR:
                    T *= 1 - ti.min(ti.exp(q), ALPHA_CAP)
                    transmittance[row, column] = ti.select(T < STOP, 0.0, T)
                    marks[g] = 1
