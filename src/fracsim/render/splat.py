"""The host side of the rasteriser: project, order by depth, bin into tiles, composite all features in one pass."""

from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.util import to_taichi_type

from fracsim.arrays import Arrays, power_of_2
from fracsim.backend import on_cpu
from fracsim.camera import TILE, View
from fracsim.camera import project as project_points
from fracsim.records import Array
from fracsim.render import sh as harmonics
from fracsim.render import tiles
from fracsim.render.composite import compositor
from fracsim.render.project import projector

TILT = 0.017, 0.0105
"""Slope right and down of the direction along which Gaussians are sorted, against the optical axis. Their ratio is the
golden one, so that no short step of a lattice lies across it."""


class Splatter:
    """Renders Gaussians seen from one view. Buffers are kept between frames and grow when needed.

    Gaussians are sorted along a direction that is tilted by a degree against the optical axis. All rays of a picture
    ascend along it, so that it orders what lies on one ray as the depth does. But it also orders the layers of a face
    seen face-on, whose depths are equal up to round-off, by their place in the picture.
    """

    def __init__(self, view: View, features: int, dtype: Any = np.float32, tilt: tuple[float, float] = TILT) -> None:
        """`features` channels a Gaussian; arithmetic and results in `dtype`, float32 or float64.

        `tilt` (0, 0) sorts by depth, as 3DGS does.
        """
        self.view, self.features, self.dtype, self.tilt = view, features, np.dtype(dtype), tilt
        self._real = to_taichi_type(self.dtype)
        self._composite = compositor(features, TILE if on_cpu() else 1, self._real)
        rows, columns = view.height // TILE, view.width // TILE
        self._arrays = Arrays(self)
        self._table = self._arrays.zeros(ti.i32, tiles.CHUNKS, rows, columns)
        self._starts = self._arrays.zeros(ti.i32, rows * columns + 1)
        self._entries = self._arrays.zeros(ti.i32, 1)
        self._capacity = 0

    def render(
        self, means: Array, covariance: Array, F: Array, opacity: Array, features: Array
    ) -> tuple[Array, Array, Array]:
        """Image (H, W, C), alpha (H, W) and median depth (H, W) [m] of N Gaussians.

        means (N, 3) [m]; covariance A (N, 6) at rest, xx xy xz yy yz zz [m^2], rendered as F A F^T; F (N, 3, 3);
        opacity (N,) in [0, 1]; features (N, C). No background is blended in: add background * (1 - alpha). The median
        depth is that at which the transmittance falls below 1/2, infinite if it never does. Raises ValueError on a
        wrong shape.
        """
        given = {"means": means, "covariance": covariance, "F": F, "opacity": opacity, "features": features}
        gaussians = [self._checked(name, array, len(means)) for name, array in given.items()]
        size = self.view.height, self.view.width
        image = np.zeros((*size, self.features), self.dtype)
        transmittance, median = np.ones(size, self.dtype), np.full(size, np.inf, self.dtype)
        if len(means) and self._bin(*gaussians[:4]):
            self._composite(self._starts, self._entries, self._ellipse, self._depth, gaussians[4],
                            image, transmittance, median)  # fmt: skip
        return image, 1 - np.abs(transmittance), median

    def tile_lists(self) -> tuple[Any, Any, Any]:
        """The compositor's `starts` (tiles + 1,), `entries` (entries,) and `ellipse` (N,) of the last image."""
        return self._starts, self._entries, self._ellipse

    def _checked(self, name: str, array: Array, n: int) -> Array:
        """`array`, contiguous and in the working precision; raises ValueError unless its shape fits n Gaussians.

        Shapes: means (n, 3), covariance (n, 6), F (n, 3, 3), opacity (n,), features (n, C).
        """
        tail = {"means": (3,), "covariance": (6,), "F": (3, 3), "opacity": (), "features": (self.features,)}[name]
        if array.shape != (n, *tail):
            raise ValueError(f"splat: {name} has shape {array.shape}, expected {(n, *tail)}.")
        return np.ascontiguousarray(array, self.dtype)

    def _bin(self, means: Array, covariance: Array, F: Array, opacity: Array) -> int:
        """Project, sort and list the Gaussians of each tile; returns the number of entries.

        Takes means (N, 3), covariance (N, 6), F (N, 3, 3) and opacity (N,) as in `render`.
        """
        self._reserve(len(means))
        self._project(means, covariance, F, opacity)
        order = tiles.depth_order(self._key.to_numpy()[: len(means)])
        tiles.count(order, self._rectangle, self._table)
        chunk_starts, tile_starts = tiles.starts(self._table.to_numpy())
        total = int(tile_starts[-1])
        if total > self._entries.shape[0]:
            self._entries = self._arrays.zeros(ti.i32, power_of_2(total + total // 4))
        self._table.from_numpy(chunk_starts)
        self._starts.from_numpy(tile_starts)
        tiles.fill(order, self._rectangle, self._table, self._entries)
        return total

    def _reserve(self, n: int) -> None:
        """Enlarge the buffers of the projection to n Gaussians."""
        if n > self._capacity:
            self._capacity = n
            self._depth = self._arrays.zeros(self._real, n)
            self._key = self._arrays.zeros(self._real, n)
            self._rectangle = self._arrays.zeros(ti.i32, n, element=(4,))
            self._ellipse = self._arrays.zeros(self._real, n, element=(8,))

    def _project(self, means: Array, covariance: Array, F: Array, opacity: Array) -> None:
        """Fill depth, key, rectangle and ellipse from means (N, 3), covariance (N, 6), F (N, 3, 3) and opacity (N,)."""
        view = self.view
        projector(self._real)(
            means, covariance, F, opacity, view.rotation, view.world_to_camera[:3, 3], (view.fx, view.fy),
            (view.cx, view.cy), (view.width, view.height), view.near, self.tilt, self._depth, self._key,
            self._rectangle, self._ellipse,
        )  # fmt: skip


def colours(view: View, means: Array, sh: Array, R: Array) -> Array:
    """Colours, (N, 3), of Gaussians at means (N, 3) [m], turned by R (N, 3, 3), with coefficients sh (N, K, 3).

    Directions from the eye are turned back by R^T (see `fracsim.render.sh`). Raises ValueError unless K is 1, 4, 9
    or 16.
    """
    from_eye = means - view.eye.astype(means.dtype)
    return harmonics.colour(sh, np.einsum("nji,nj->ni", R, from_eye))


def visibility(view: View, median: Array, points: Array, tolerance: float) -> Array:
    """Whether each point, (N, 3) [m], is visible, (N,): inside the image, at most `tolerance` [m] behind the median
    depth.

    `median`, (H, W) [m], is the third result of `Splatter.render`. So at most half the light is lost in front of a
    visible point, up to the tolerance.
    """
    xy, depth = project_points(view, points)
    inside = (depth > view.near) & ((xy >= 0) & (xy < (view.width, view.height))).all(axis=1)
    column, row = xy[inside].astype(int).T
    inside[inside] = depth[inside] <= median[row, column] + tolerance
    return inside
