"""Meshes as particles (asset.kind=mesh): what is inside, how far the surface is, which colour it has there.

y is up, as in glTF; an OBJ or STL file drawn with z up needs asset.rotate_deg=[-90,0,0].
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

from fracsim.asset import fill, gaussians, limits, paint, place, surface, weld
from fracsim.asset.nearest import Nearest
from fracsim.asset.rays import Rays
from fracsim.asset.surface import Surface
from fracsim.asset.twin import twin
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

REACH = 1.0  # spacings from the surface up to which a point is moved onto it
STRAY = 0.005  # parts smaller than this fraction of the largest are crumbs of a doubtful inside

SEAMS = "The mesh is not watertight as stored; welding vertices at equal positions closed it, so its inside is exact."


def prepare(asset: Asset, spacing: float, seed: int) -> Particles:
    """Particles of the mesh file asset.path; raises ValueError when it cannot be used."""
    skin = _placed(surface.read(asset.path), asset)
    solid = MeshSolid(skin, spacing)
    limits.estimate(asset, spacing, *solid.mesh.rough, solid.bounds)
    filling = fill.fill(twin(solid, spacing, seed, lambda: MeshSolid(skin, spacing)), spacing)
    if not len(filling.X):
        raise ValueError(
            f"asset.path={asset.path} encloses no volume: a solid needs a closed, or nearly closed, surface. "
            "Give the sheet a thickness, or close its holes."
        )
    rgb = _painted(solid, filling, asset, spacing, seed)
    return gaussians.particles(filling, rgb, spacing, solid.notes)


def _placed(skin: Surface, asset: Asset) -> Surface:
    """The surface in the world, without triangles that have no area."""
    R = place.rotation(asset.rotate_deg)
    turned = skin.corners @ R.T
    placement = place.fit(asset, turned.min(axis=(0, 1)), turned.max(axis=(0, 1)))
    corners = placement.to_world(skin.corners)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    real = np.linalg.norm(cross, axis=1) > 1e-12 * asset.size**2
    normals, rgb, uv, texture = (a[real] for a in (skin.normals @ R.T, skin.rgb, skin.uv, skin.texture))
    return replace(skin, corners=corners[real], normals=normals, rgb=rgb, uv=uv, texture=texture)


class MeshSolid:
    """The solid that a surface bounds; open, overlapping and inconsistently oriented surfaces are put up with."""

    def __init__(self, skin: Surface, spacing: float) -> None:
        """`skin` in the world [m]."""
        self.skin, self.spacing, self.notes = skin, spacing, skin.notes
        self.volume: float | None = None
        self.bounds = skin.corners.min(axis=(0, 1)), skin.corners.max(axis=(0, 1))
        self.mesh = weld.weld(skin.corners)
        self._fine: tuple[float, Rays] | None = None

    def distance(self, axes: list[Array]) -> Array:
        """Signed distances on a grid, exact within two and a half grid steps, mostly +-inf beyond."""
        inside = self._inside(axes)
        self.nearest = Nearest(self.skin.corners, 0.5 * self.spacing)
        if self.volume is None:
            self.nearest.drop(self._buried(inside))
        d = np.where(inside, -np.inf, np.inf)
        close = self._close(inside.shape)
        P = fill.points(axes, np.argwhere(close))
        S, _, _ = self.nearest(P, candidates=4)
        d[close] = np.where(inside[close], -1.0, 1.0) * np.linalg.norm(P - S, axis=1)
        return d if self.mesh.closed else _lidded(d, inside, self.spacing)

    def contains(self, axes: list[Array], index: Array) -> Array:
        """Whether grid points (M, 3) are inside, (M,) bool."""
        step = float(axes[0][1] - axes[0][0])
        if self._fine is None or self._fine[0] != step:
            self._fine = step, Rays(self.mesh.corners, axes, self.mesh.closed, self.mesh.oriented)
        return np.abs(self._fine[1].winding(index)[0]) > 0.5

    def settle(self, P: Array, depth: float) -> tuple[Array, Array]:
        """Along the normal of the nearest surface point to `depth` [m] below it; see `fracsim.asset.fill.Solid`."""
        S, normal = self.skin_at(P)
        Q = S - depth * normal
        opposite, other = self.skin_at(Q)
        # What went through a thin wall goes back to the middle of it.
        lost = np.einsum("ij,ij->i", Q - opposite, other) > 0
        Q[lost] = (S[lost] + opposite[lost]) / 2
        far = np.linalg.norm(P - S, axis=1) > REACH * self.spacing
        Q[far], normal[far] = P[far], 0.0
        return Q, normal

    def skin_at(self, P: Array) -> tuple[Array, Array]:
        """Nearest surface points, (N, 3), and the outward normals there, (N, 3)."""
        S, face, bary = self.nearest(P)
        normal = np.einsum("nc,ncj->nj", bary, self.skin.normals[face])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        ahead, behind = (self._insideness(S + side * 0.7 * self.spacing * normal) for side in (1, -1))
        normal[ahead > behind] *= -1
        return S, normal

    def _inside(self, axes: list[Array]) -> Array:
        """Whether grid points are inside, (nx, ny, nz) bool; sets the volume if it is exact, and the notes."""
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
            inside = _without_crumbs(inside, doubtful)
            self.notes += (_open_note(doubtful[inside]),)
        elif self.mesh.oriented and len(np.unique(winding)) <= 2:
            self.volume = self.mesh.volume
        if self.mesh.closed and not self.skin.watertight:
            self.notes += (SEAMS,)
        self.origin = np.array([a[0] for a in axes])
        self.inside = inside.astype(np.float32)
        return inside

    def _insideness(self, P: Array) -> Array:
        """Linear interpolation of the inside on the grid at P (N, 3), (N,) in [0, 1]."""
        at = ((P - self.origin) / self.spacing).T
        values: Array = map_coordinates(self.inside, at, order=1, mode="nearest")
        return values

    def _cells(self, shape: tuple[int, ...]) -> tuple[Array, ...]:
        """Indices of the grid points nearest to the surface samples."""
        index = np.round((self.nearest.samples - self.origin) / self.spacing).astype(int)
        return tuple(np.clip(index, 0, np.array(shape) - 1).T)

    def _buried(self, inside: Array) -> Array:
        """Which surface samples have nothing but inside about them, as where bodies overlap, (S,) bool."""
        deep: Array = binary_erosion(inside, np.ones((3, 3, 3)))
        return deep[self._cells(inside.shape)]

    def _close(self, shape: tuple[int, ...]) -> Array:
        """Grid points within two and a half steps of the surface, (nx, ny, nz) bool."""
        hit = np.zeros(shape, np.uint8)
        hit[self._cells(shape)] = 1
        return np.asarray(maximum_filter(hit, 7) > 0)


def _open_note(doubtful: Array) -> str:
    share = doubtful.mean() if len(doubtful) else 0.0
    return (
        "The mesh is not watertight: points are inside where the winding number, estimated from rays in the six "
        f"directions of the axes, exceeds 1/2; the rays disagreed at {share:.1%} of them."
    )


def _without_crumbs(inside: Array, doubtful: Array) -> Array:
    """The inside with doubtful points decided by their neighbours, without tiny parts and tiny doubtful pockets."""
    inside = np.where(doubtful, median_filter(inside.astype(np.uint8), 3) > 0, inside)
    parts, size = _parts(inside)
    least = STRAY * size.max()
    inside = (size >= max(least, 1))[parts]
    pockets, size = _parts(~inside)
    share = np.bincount(pockets.ravel(), doubtful.ravel(), len(size)) / np.maximum(size, 1)
    tiny = (0 < size) & (size < least) & (share > 0.5)
    out: Array = inside | tiny[pockets]
    return out


def _parts(mask: Array) -> tuple[Array, Array]:
    """Numbers of the connected parts of a grid, (nx, ny, nz), 0 where there is none, and their sizes, 0 first."""
    parts, n = label(mask)
    size = np.bincount(parts.ravel(), minlength=n + 1)
    size[0] = 0
    return parts, size


def _lidded(d: Array, inside: Array, spacing: float) -> Array:
    """Distances that also see the boundary of the inside where there is no surface, as across a hole."""
    lid = spacing * (distance_transform_edt(inside) - 0.5)
    return np.where(inside & (-d > lid + spacing), -lid, d)


def _painted(solid: MeshSolid, filling: fill.Filling, asset: Asset, spacing: float, seed: int) -> Array:
    """Colours (N, 3): the lit surface down to a skin, below it the inside."""
    P, top = filling.X, filling.surface
    S, _ = gaussians.lifted(filling, spacing)
    unlit = _footprint(solid, S[top], filling.normal[top], spacing)
    rgb = paint.inside(asset.interior, unlit, (P - place.HOME) / asset.size, seed)
    rgb[top] = paint.lit(unlit, filling.normal[top])
    under = np.flatnonzero(~top & (filling.depth < paint.DEEP * spacing))
    S, face, bary = solid.nearest(P[under])
    normal = (S - P[under]) / np.maximum(np.linalg.norm(S - P[under], axis=1, keepdims=True), 1e-12)
    skin = paint.lit(paint.sample(solid.skin, face, bary), normal)
    rgb[under] = paint.blend(skin, rgb[under], filling.depth[under] / spacing)
    return rgb


def _footprint(solid: MeshSolid, S: Array, normal: Array, spacing: float) -> Array:
    """Mean colour (N, 3) over what surface particles at S (N, 3) cover."""
    covered = gaussians.footprint(S, normal, spacing)
    looks = [paint.sample(solid.skin, *solid.nearest(P)[1:]) for P in covered]
    mean: Array = np.mean(looks, axis=0)
    return mean
