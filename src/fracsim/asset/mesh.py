"""Meshes as particles (asset.kind=mesh): the inside, the distance to the surface, and its colour.

y is up, as in glTF. An OBJ or STL file drawn with z up needs asset.rotate_deg=[-90,0,0].
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import (
    binary_erosion,
    distance_transform_edt,
    label,
    map_coordinates,
    maximum_filter,
    median_filter,
)
from scipy.spatial import cKDTree

from fracsim.asset import bodies, fill, gaussians, limits, paint, place, weld
from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.asset.mesh_file import read
from fracsim.asset.nearest import Nearest
from fracsim.asset.rays import Rays
from fracsim.asset.surface import Surface
from fracsim.asset.twin import twin
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

REACH = 1.0
"""Points farther than this from the surface are not moved onto it [particle spacings]."""
SPECK = 0.005
"""Parts of a doubtful inside that are smaller than this fraction of the largest part are dropped."""

BARE, PARTLY_BARE = 0.5, 0.05
"""Shares of the surface without a particle within a spacing: above the first the object is refused, above the second
noted.
"""
CHANCE = 0.25
"""Walls thinner than this have particles where samples of the filling happen to hit them [particle spacings]."""
MOST_FINER = 10
"""Times by which solver.cells may be raised in earnest."""

SEAMS = "The mesh is not watertight as stored; welding vertices at equal positions closed it"
EXACT, SAMPLED = ", so its inside is exact.", "; its bodies overlap, so its volume is that of samples."


def prepare(asset: Asset, spacing: float, seed: int, frame: LatticeFrame = WORLD) -> Particles:
    """Particles `spacing` [m] apart, in `frame`, of the mesh file asset.path.

    Raises ValueError if it cannot be used.
    """
    surface = _placed(_without_outliers(read(asset.path)), asset, frame)
    solid = MeshSolid(surface, spacing)
    limits.estimate(asset, spacing, *solid.mesh.rough, solid.bounds)
    filling = fill.fill(twin(solid, spacing, seed, lambda: MeshSolid(surface, spacing)), spacing)
    if not len(filling.X):
        raise ValueError(
            f"asset.path={asset.path} encloses no volume: a solid needs a closed, or nearly closed, surface. "
            "Give the sheet a thickness, or close its holes."
        )
    solid.notes += _bare(solid, filling.X, asset, spacing)
    rgb = _painted(solid, filling, asset, spacing, seed, frame)
    return gaussians.particles(filling, rgb, spacing, solid.notes)


def _without_outliers(surface: Surface) -> Surface:
    """The surface without what encloses nothing and would decide size and centre of the object, and a note on it."""
    out = bodies.outliers(surface.corners)
    if not out.any():
        return surface
    kept, all_ = (float(np.ptp(c, axis=(0, 1)).max()) for c in (surface.corners[~out], surface.corners))
    note = (
        f"{int(out.sum())} triangles that enclose nothing, as a ground plane or stray ones, reach out to "
        f"{all_ / kept:.3g} times the extent of the rest and were left out: asset.size is that of the rest."
    )
    return replace(surface.some(~out), notes=(*surface.notes, note))


def _bare(solid: "MeshSolid", X: Array, asset: Asset, spacing: float) -> tuple[str, ...]:
    """A note on the share of the surface without one of the particles X (N, 3) within a spacing.

    Raises ValueError if that is most of it: a shell so thin is not what the file shows.
    """
    faces, corners = solid.nearest.face, solid.surface.corners
    a, b, c = corners.transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    weight = (area / np.maximum(np.bincount(faces, minlength=len(area)), 1))[faces]
    gap, _ = cKDTree(X).query(solid.nearest.samples)
    share = float(weight[gap > spacing].sum() / weight.sum())
    if share < PARTLY_BARE:
        return ()
    thick = 2 * solid.mesh.rough[0] / solid.mesh.rough[1]
    if share > BARE or thick < CHANCE * spacing:
        finer = max(2, int(np.ceil(0.5 * spacing / thick)))
        way = f", or raise solver.cells to {finer} times as many" if finer <= MOST_FINER else ""
        raise ValueError(
            f"asset.path={asset.path} is a shell about {thick:.2g} m thick, too thin for particles {spacing:g} m "
            f"apart: {share:.0%} of its surface has none within a spacing. Give it walls of at least "
            f"{0.5 * spacing:g} m, as by the Solidify modifier of Blender{way}."
        )
    return (f"{share:.0%} of the surface has no particle within a spacing: there the object is too thin for it.",)


def _placed(surface: Surface, asset: Asset, frame: LatticeFrame) -> Surface:
    """The surface in the frame, without triangles of no area."""
    R = place.rotation(asset.rotate_deg)
    turned = surface.corners @ R.T
    placement = place.fit(asset, turned.min(axis=(0, 1)), turned.max(axis=(0, 1)))
    if frame.degrees:
        placement = placement.turned(frame.R.T)
    corners = placement.to_world(surface.corners)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    real = np.linalg.norm(cross, axis=1) > 1e-12 * asset.size**2
    return replace(surface, corners=corners, normals=surface.normals @ placement.R.T).some(real)


class MeshSolid:
    """The `fracsim.asset.fill.Solid` that a surface bounds; it may be open, overlapping or inconsistently oriented."""

    def __init__(self, surface: Surface, spacing: float) -> None:
        """`surface` in the frame of the grids to come [m]."""
        self.surface, self.spacing, self.notes = surface, spacing, surface.notes
        self.volume: float | None = None
        self.bounds = surface.corners.min(axis=(0, 1)), surface.corners.max(axis=(0, 1))
        self.mesh = weld.weld(surface.corners)
        self._fine: tuple[float, Rays] | None = None

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances [m], (nx, ny, nz), on the grid of three coordinate arrays.

        They are exact within two and a half grid steps of the surface, mostly +-inf beyond.
        """
        inside = self._inside(axes)
        self.nearest = Nearest(self.surface.corners, 0.5 * self.spacing)
        if self.volume is None:
            self.nearest.drop(self._buried(inside))
        d = np.where(inside, -np.inf, np.inf)
        close = self._close(inside.shape)
        P = fill.points(axes, np.argwhere(close))
        S, _, _ = self.nearest(P, candidates=4)
        d[close] = np.where(inside[close], -1.0, 1.0) * np.linalg.norm(P - S, axis=1)
        return d if self.mesh.closed else _capped(d, inside, self.spacing)

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether the points with indices (M, 3) of the grid of three coordinate arrays are inside, (M,) bool."""
        step = float(axes[0][1] - axes[0][0])
        if self._fine is None or self._fine[0] != step:
            self._fine = step, Rays(self.mesh.corners, axes, self.mesh.closed, self.mesh.oriented)
        return np.abs(self._fine[1].winding(index)[0]) > 0.5

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Points `depth` [m] below the surface points nearest to P (N, 3), (N, 3), and the normals there, (N, 3).

        A point farther than REACH from the surface stays and has a zero normal.
        """
        S, normal = self.surface_at(P)
        Q = S - depth * normal
        opposite, other = self.surface_at(Q)
        # A point that has passed through a thin wall is moved back to its middle.
        lost = np.einsum("ij,ij->i", Q - opposite, other) > 0
        Q[lost] = (S[lost] + opposite[lost]) / 2
        far = np.linalg.norm(P - S, axis=1) > REACH * self.spacing
        Q[far], normal[far] = P[far], 0.0
        return Q, normal

    def surface_at(self, P: Array) -> tuple[Array, Array]:
        """Surface points nearest to P (N, 3), (N, 3), and the outward normals there, (N, 3)."""
        S, face, bary = self.nearest(P)
        normal = np.einsum("nc,ncj->nj", bary, self.surface.normals[face])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        ahead, behind = (self._insideness(S + side * 0.7 * self.spacing * normal) for side in (1, -1))
        normal[ahead > behind] *= -1
        return S, normal

    def _inside(self, axes: list[Array]) -> Array:
        """Whether points of the grid of three coordinate arrays are inside, (nx, ny, nz) bool.

        Sets the volume if it is exact, and the notes.
        """
        shape = tuple(len(a) for a in axes)
        rays = Rays(self.mesh.corners, axes, self.mesh.closed, self.mesh.oriented)
        winding, doubtful = np.zeros(shape), np.zeros(shape, bool)
        for rows in fill.slabs(axes):
            index = np.argwhere(np.ones_like(doubtful[rows])) + (rows.start, 0, 0)
            w, unsure = rays.winding(index)
            winding[rows], doubtful[rows] = (
                w.reshape(winding[rows].shape),
                unsure.reshape(winding[rows].shape),
            )
        inside = np.abs(winding) > 0.5
        if not self.mesh.closed:
            inside = _without_specks(inside, doubtful)
            self.notes += (_open_note(doubtful[inside]),)
        elif self.mesh.oriented and len(np.unique(winding)) <= 2:
            self.volume = self.mesh.volume
        if self.mesh.closed and not self.surface.watertight:
            self.notes += (SEAMS + (SAMPLED if self.volume is None else EXACT),)
        self.origin = np.array([a[0] for a in axes])
        self.inside = inside.astype(np.float32)
        return inside

    def _insideness(self, P: Array) -> Array:
        """Inside (1) or outside (0) of the grid, interpolated linearly at P (N, 3), (N,)."""
        at = ((P - self.origin) / self.spacing).T
        values: Array = map_coordinates(self.inside, at, order=1, mode="nearest")
        return values

    def _cells(self, shape: tuple[int, ...]) -> tuple[Array, ...]:
        """Three index arrays, (S,) each, of the grid points nearest to the surface samples."""
        index = np.round((self.nearest.samples - self.origin) / self.spacing).astype(int)
        return tuple(np.clip(index, 0, np.array(shape) - 1).T)

    def _buried(self, inside: Array) -> Array:
        """Whether a surface sample is surrounded by the inside, (S,) bool, as where bodies overlap.

        `inside` is (nx, ny, nz) bool.
        """
        deep: Array = binary_erosion(inside, np.ones((3, 3, 3)))
        return deep[self._cells(inside.shape)]

    def _close(self, shape: tuple[int, ...]) -> Array:
        """Whether a grid point is within two and a half steps of the surface, (nx, ny, nz) bool."""
        hit = np.zeros(shape, np.uint8)
        hit[self._cells(shape)] = 1
        return np.asarray(maximum_filter(hit, 7) > 0)


def _open_note(doubtful: Array) -> str:
    """The note on a mesh that is not watertight; `doubtful` (M,): whether the rays disagreed at an inner point."""
    share = doubtful.mean() if len(doubtful) else 0.0
    return (
        "The mesh is not watertight: points are inside where the winding number, estimated from rays in the six "
        f"directions of the axes, exceeds 1/2; the rays disagreed at {share:.1%} of them."
    )


def _without_specks(inside: Array, doubtful: Array) -> Array:
    """The inside, (nx, ny, nz) bool, after three corrections of `inside` and `doubtful`, (nx, ny, nz) bool each.

    The neighbours decide on doubtful points. Tiny parts are dropped. Tiny, mostly doubtful pockets are filled.
    """
    inside = np.where(doubtful, median_filter(inside.astype(np.uint8), 3) > 0, inside)
    parts, size = _parts(inside)
    least = SPECK * size.max()
    inside = (size >= max(least, 1))[parts]
    pockets, size = _parts(~inside)
    share = np.bincount(pockets.ravel(), doubtful.ravel(), len(size)) / np.maximum(size, 1)
    tiny = (0 < size) & (size < least) & (share > 0.5)
    out: Array = inside | tiny[pockets]
    return out


def _parts(mask: Array) -> tuple[Array, Array]:
    """Connected parts of `mask`, (nx, ny, nz) bool: part number at each point, (nx, ny, nz), and part sizes, (parts,).

    Number 0 is the rest of the grid; its size is set to 0.
    """
    parts, n = label(mask)
    size = np.bincount(parts.ravel(), minlength=n + 1)
    size[0] = 0
    return parts, size


def _capped(d: Array, inside: Array, spacing: float) -> Array:
    """Signed distances [m], (nx, ny, nz), that treat the boundary of `inside` across a hole as surface too.

    `d` [m] and `inside` are (nx, ny, nz).
    """
    cap = spacing * (distance_transform_edt(inside) - 0.5)
    return np.where(inside & (-d > cap + spacing), -cap, d)


def _painted(
    solid: MeshSolid, filling: fill.Filling, asset: Asset, spacing: float, seed: int, frame: LatticeFrame
) -> Array:
    """Colours (N, 3): near the surface that of the lit surface, below it that of the inside."""
    P, top = filling.X, filling.surface
    S, _ = gaussians.lifted(filling, spacing)
    unlit = _footprint(solid, S[top], filling.normal[top], spacing)
    rgb = paint.inside(asset.interior, unlit, frame.vectors_to_world(P - place.HOME) / asset.size, seed)
    rgb[top] = paint.lit(unlit, frame.vectors_to_world(filling.normal[top]))
    under = np.flatnonzero(~top & (filling.depth < paint.DEEP * spacing))
    S, face, bary = solid.nearest(P[under])
    normal = (S - P[under]) / np.maximum(np.linalg.norm(S - P[under], axis=1, keepdims=True), 1e-12)
    above = paint.lit(paint.sample(solid.surface, face, bary), frame.vectors_to_world(normal))
    rgb[under] = paint.blend(above, rgb[under], filling.depth[under] / spacing)
    return rgb


def _footprint(solid: MeshSolid, S: Array, normal: Array, spacing: float) -> Array:
    """Mean colour (N, 3) over the footprints of surface particles at S (N, 3) with normals (N, 3)."""
    covered = gaussians.footprint(S, normal, spacing)
    samples = [paint.sample(solid.surface, *solid.nearest(P)[1:]) for P in covered]
    mean: Array = np.mean(samples, axis=0)
    return mean
