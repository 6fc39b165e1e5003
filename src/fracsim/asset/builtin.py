"""Built-in objects as particles (asset.kind=builtin)."""

import itertools
from types import ModuleType

import numpy as np

from fracsim import registry
from fracsim.asset import fill, gaussians, implicit, limits, place
from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.asset.twin import twin
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

DIFFERENCE = 0.2
"""Half width of the difference quotients [particle spacings]."""


def prepare(asset: Asset, spacing: float, seed: int, frame: LatticeFrame = WORLD) -> Particles:
    """Particles `spacing` [m] apart, in `frame`, of the built-in object asset.name; a `seed` above 0 shifts them.

    Raises ValueError for an unknown name or too many particles.
    """
    module = registry.load("fracsim.asset.objects", asset.name, "asset.name")
    return of_module(module, asset, spacing, seed, frame)


def of_module(
    module: ModuleType, asset: Asset, spacing: float, seed: int = 0, frame: LatticeFrame = WORLD
) -> Particles:
    """Particles `spacing` [m] apart, in `frame`, of an object module (see `fracsim.asset.objects`).

    Raises ValueError if they are too many.
    """
    placement, lo, hi = _placed(module, asset, frame)

    def field(P: Array) -> Array:
        """Signed distance [m], (N,), at points of the frame [m], (N, 3)."""
        d: Array = module.distance(placement.to_object(P).astype(np.float32)) * placement.scale
        return d

    limits.estimate(asset, spacing, *implicit.measure(field, lo, hi), (lo, hi))
    solid = implicit.Implicit(field, lo, hi, DIFFERENCE * spacing)
    filling = fill.fill(twin(solid, spacing, seed), spacing)

    def colour(P: Array, depth: Array) -> Array:
        """sRGB (N, 3) at points of the frame [m], (N, 3), `depth` [m], (N,), below the surface."""
        at = placement.to_object(P).astype(np.float32), (depth / placement.scale).astype(np.float32)
        return np.asarray(np.clip(module.colour(*at), 0.0, 1.0))

    P, depth = gaussians.lifted(filling, spacing)
    rgb, top = np.empty_like(P), filling.surface
    rgb[~top] = colour(P[~top], depth[~top])
    rgb[top] = np.mean([colour(Q, depth[top]) for Q in gaussians.footprint(P[top], filling.normal[top], spacing)], 0)
    return gaussians.particles(filling, rgb, spacing)


def _placed(module: ModuleType, asset: Asset, frame: LatticeFrame) -> tuple[place.Placement, Array, Array]:
    """Placement of the object in the frame, and the corners lo and hi, (3,), of its bounding box there [m].

    Size and centre are those of its bounding box in the world.
    """
    R = place.rotation(asset.rotate_deg)
    lo, hi = _box(module, R)
    placement = place.fit(asset, lo, hi)
    if frame.degrees:
        placement = placement.turned(frame.R.T)
        lo, hi = _box(module, placement.R)
    centre = placement.scale * ((lo + hi) / 2 - placement.middle) + place.HOME
    half = placement.scale * (hi - lo) / 2
    return placement, centre - half, centre + half


def _box(module: ModuleType, R: Array) -> tuple[Array, Array]:
    """The corners lo and hi, (3,), of the bounding box of the object turned by R (3, 3), in object units."""
    corners = np.array(list(itertools.product(*zip(*module.BOUNDS, strict=True)))) @ R.T

    def turned(P: Array) -> Array:
        """Signed distance (N,) of the turned object at points (N, 3), in object units."""
        d: Array = module.distance((P @ R).astype(np.float32))
        return d

    return implicit.tight_box(turned, corners.min(axis=0), corners.max(axis=0))
