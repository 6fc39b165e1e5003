"""An object from one photo (asset.kind=image): cut out, inflated, textured by the photo, filled like any other.

The body is such that its front view, from PHOTO_DISTANCE, is the photo inside the outline: what bulges towards the eye
is narrower, as far as the camera enlarges it. A skin of Gaussians, finer than the particles, carries the picture on the
front. They have no volume: they are drawn only, and ride on the particles below.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from fracsim.asset import fill, gaussians, implicit, limits, paint, place, skin
from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.asset.inflate import Relief, inflate
from fracsim.asset.twin import twin
from fracsim.camera import PHOTO_DISTANCE
from fracsim.photo.outline import Outline, outline
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

DIFFERENCE = 0.2
"""Half width of the difference quotients [particle spacings]."""
SKINS = 200
"""Gaussians of the skin along the outline's extent, at least."""
UNDER = 0.6
"""Size of the Gaussians below the skin, in that of others: flat and as large, they would reach out where it is curved.
"""


def prepare(asset: Asset, spacing: float, seed: int, frame: LatticeFrame = WORLD) -> Particles:
    """Particles `spacing` [m] apart, in `frame`, of the object in the photo asset.path.

    Raises ValueError if it cannot be used, or needs too many particles.
    """
    seen = outline(asset)
    body = _body(seen, asset)
    placement = place.Placement(place.rotation(asset.rotate_deg), asset.size, np.zeros(3))
    if frame.degrees:
        placement = placement.turned(frame.R.T)

    def field(P: Array) -> Array:
        """Signed distance [m], (N,), at points of the frame [m], (N, 3)."""
        return asset.size * body.distance(placement.to_object(P))

    lo, hi = implicit.tight_box(field, *_reach(placement, asset))
    limits.estimate(asset, spacing, *implicit.measure(field, lo, hi), (lo, hi))
    solid = implicit.Implicit(field, lo, hi, DIFFERENCE * spacing)
    filling = fill.fill(twin(solid, spacing, seed), spacing)
    if not len(filling.X):
        raise ValueError(f"asset.path={asset.path}: the object in the photo is too thin for particles {spacing:g} m "
                         "apart: raise asset.depth, asset.size or solver.cells.")  # fmt: skip
    below = gaussians.particles(filling, _colours(filling, seen, body, placement, asset, spacing, seed), spacing)
    return _covered(below, _skin(seen, body, placement, asset, spacing), asset, spacing)


@dataclass(frozen=True, eq=False)
class Body:
    """The inflated outline in its largest extents; its box's centre is 0, and the eye is at z = PHOTO_DISTANCE."""

    relief: Relief
    flat: bool
    """Whether the back is flat."""

    @property
    def rim(self) -> float:
        """z of the plane of the outline."""
        return -self.relief.top / 2 if self.flat else 0.0

    def distance(self, P: Array) -> Array:
        """Signed distance (N,), approximate away from the surface, at points (N, 3)."""
        x, y, z = P.T
        larger = PHOTO_DISTANCE / (PHOTO_DISTANCE - z)
        u, ux, uy = self.relief(x * larger, y * larger)
        z = z - self.rim
        d = (z * z - u) / np.sqrt(4 * z * z + ux * ux + uy * uy + 1e-6)
        if self.flat:
            d = np.maximum(d, -z)
        return np.asarray(np.maximum(d, self.relief.beyond(x * larger, y * larger)))

    def front(self, at: Array) -> Array:
        """The points of the front, (N, 3), that the eye sees at points of the plane, (N, 2)."""
        h = np.sqrt(np.maximum(self.relief(*at.T)[0], 0))
        z = self.rim + h
        return np.column_stack([at * (1 - z / PHOTO_DISTANCE)[:, None], z])


def _body(seen: Outline, asset: Asset) -> Body:
    """The body of an outline; raises ValueError for one that is a line."""
    lo, hi = (corner.astype(int) for corner in seen.box)
    flat = asset.back == "flat"
    cut = seen.mask[lo[1] : hi[1], lo[0] : hi[0]]
    try:
        return Body(inflate(cut, asset.depth, flat_back=flat, flat_base=asset.base == "flat"), flat)
    except ValueError as error:
        raise ValueError(f"asset.path={asset.path}: the object in the photo cannot be inflated, since {error}: give a "
                         "photo, or a mask by asset.mask=FILE, of a thicker object.") from None  # fmt: skip


def _reach(placement: place.Placement, asset: Asset) -> tuple[Array, Array]:
    """Corners of a box, (3,) each, that holds the body in the frame [m]."""
    half = 0.5 * asset.size * (1 + asset.depth)
    return place.HOME - half, place.HOME + half


def _picture(seen: Outline, P: Array, width: float) -> Array:
    """Colours (N, 3) of the photo where the eye sees points (N, 3) of the object; a mean over `width` extents."""
    at = P[:, :2] * (PHOTO_DISTANCE / (PHOTO_DISTANCE - P[:, 2]))[:, None]
    return seen.colours(at, width)


def _colours(
    filling: fill.Filling,
    seen: Outline,
    body: Body,
    placement: place.Placement,
    asset: Asset,
    spacing: float,
    seed: int,
) -> Array:
    """Colours (N, 3) of a filling: those of the photo near the surface, also behind; those of the inside below."""
    own = placement.to_object(filling.X)
    rgb = _picture(seen, own, spacing / asset.size)
    inner = paint.inside(asset.interior, rgb[filling.surface], own @ placement.R.T, seed)
    depth = np.where(filling.surface, 0.0, filling.depth) / spacing
    return paint.blend(rgb, inner, depth)


def _skin(seen: Outline, body: Body, placement: place.Placement, asset: Asset, spacing: float) -> Particles:
    """The Gaussians of the front, without volume, in the frame."""
    pitch = min(1 / SKINS, spacing / asset.size)
    half = int(0.5 / pitch)
    index = np.stack(np.meshgrid(*[np.arange(-half, half + 1)] * 2), axis=-1).reshape(-1, 2)
    at = index * pitch
    u, ux, uy = body.relief(*at.T)
    # A third of the pitch from the outline on; the slope of u is its value over the distance there.
    inside = (u > 0.3 * pitch * np.hypot(ux, uy)) & (u > 0) & (body.relief.beyond(*at.T) < -0.3 * pitch)
    at, index, u, ux, uy = at[inside], index[inside], u[inside], ux[inside], uy[inside]
    P, h = body.front(at), np.sqrt(u)
    A, normal = skin.covariances(np.stack([ux, uy], axis=1) / (2 * h)[:, None], pitch)
    P -= 0.5 * skin.THIN * pitch * normal
    R = placement.scale * placement.R
    A = R @ A @ R.T
    rows, columns = np.triu_indices(3)
    return Particles(
        X=placement.to_world(P).astype(np.float32),
        volume=np.zeros(len(P), np.float32),
        covariance=A[:, rows, columns].astype(np.float32),
        opacity=np.full(len(P), gaussians.OPACITY, np.float32),
        sh=gaussians.constant_sh(skin.sharpened(seen.colours(at, pitch / 2), index, h)),
        surface=np.ones(len(P), bool),
        spacing=spacing,
    )


def _covered(below: Particles, top: Particles, asset: Asset, spacing: float) -> Particles:
    """Both together; the surface particle that is nearest to one of the skin is shown smaller."""
    limits.count(asset, spacing, len(below) + len(top))
    outer = np.flatnonzero(below.surface)
    hidden = np.zeros(len(below), bool)
    hidden[outer[cKDTree(below.X[outer]).query(top.X)[1]]] = True
    under = np.where(hidden, UNDER**2, 1)[:, None].astype(np.float32) * below.covariance
    X, volume, opacity, sh, surface = (
        np.concatenate([getattr(below, name), getattr(top, name)])
        for name in ("X", "volume", "opacity", "sh", "surface")
    )
    A = np.concatenate([under, top.covariance])
    return replace(below, X=X, volume=volume, covariance=A, opacity=opacity, sh=sh, surface=surface)
