"""Built-in objects as particles (asset.kind=builtin)."""

import itertools
from types import ModuleType

import numpy as np

from fracsim import registry
from fracsim.asset import fill, gaussians, implicit, limits, place
from fracsim.asset.twin import twin
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

DIFFERENCE = 0.2
"""Half width of the difference quotients [particle spacings]."""


def prepare(asset: Asset, spacing: float, seed: int) -> Particles:
    """Particles `spacing` [m] apart of the built-in object asset.name; a `seed` above 0 shifts them.

    Raises ValueError for an unknown name or too many particles.
    """
    module = registry.load("fracsim.asset.objects", asset.name, "asset.name")
    return of_module(module, asset, spacing, seed)


def of_module(module: ModuleType, asset: Asset, spacing: float, seed: int = 0) -> Particles:
    """Particles `spacing` [m] apart of an object module (see `fracsim.asset.objects`); ValueError if too many."""
    R = place.rotation(asset.rotate_deg)
    placement, lo, hi = _placed(module, asset, R)

    def field(P: Array) -> Array:
        """Signed distance [m], (N,), at points of the world [m], (N, 3)."""
        d: Array = module.distance(placement.to_object(P).astype(np.float32)) * placement.scale
        return d

    limits.estimate(asset, spacing, *implicit.measure(field, lo, hi), (lo, hi))
    solid = implicit.Implicit(field, lo, hi, DIFFERENCE * spacing)
    filling = fill.fill(twin(solid, spacing, seed), spacing)

    def colour(P: Array, depth: Array) -> Array:
        """sRGB (N, 3) at points of the world [m], (N, 3), `depth` [m], (N,), below the surface."""
        at = placement.to_object(P).astype(np.float32), (depth / placement.scale).astype(np.float32)
        return np.asarray(np.clip(module.colour(*at), 0.0, 1.0))

    P, depth = gaussians.lifted(filling, spacing)
    rgb, top = np.empty_like(P), filling.surface
    rgb[~top] = colour(P[~top], depth[~top])
    rgb[top] = np.mean([colour(Q, depth[top]) for Q in gaussians.footprint(P[top], filling.normal[top], spacing)], 0)
    return gaussians.particles(filling, rgb, spacing)


def _placed(module: ModuleType, asset: Asset, R: Array) -> tuple[place.Placement, Array, Array]:
    """Placement of the object turned by R (3, 3), and the corners lo and hi, (3,), of its bounding box [m]."""
    corners = np.array(list(itertools.product(*zip(*module.BOUNDS, strict=True)))) @ R.T

    def turned(P: Array) -> Array:
        """Signed distance (N,) of the turned object at points (N, 3), in object units."""
        d: Array = module.distance((P @ R).astype(np.float32))
        return d

    lo, hi = implicit.tight_box(turned, corners.min(axis=0), corners.max(axis=0))
    placement = place.fit(asset, lo, hi)
    half = placement.scale * (hi - lo) / 2
    return placement, place.HOME - half, place.HOME + half
