"""From the description of an object to its particles: prepared once, then read from the cache."""

from importlib import import_module

from fracsim.asset import cache, limits
from fracsim.asset.frame import LatticeFrame
from fracsim.records import Particles
from fracsim.scene.vocab import Asset, Scene

MODULES = {"builtin": "fracsim.asset.builtin", "mesh": "fracsim.asset.mesh", "ply": "fracsim.asset.splat",
           "image": "fracsim.asset.image"}  # fmt: skip
"""The module of each asset.kind; its `prepare(asset, spacing, seed, frame)` makes the particles, in the frame."""


def build_of(scene: Scene) -> Particles:
    """The particles of a scene's object; raises ValueError as `build`."""
    return build(scene.asset, scene.solver.spacing, scene.seed, scene.lattice_deg)


def build(asset: Asset, spacing: float, seed: int, lattice_deg: float = 0.0) -> Particles:
    """Particles `spacing` [m] apart of an object with largest extent asset.size [m], bounding box centred at CENTRE.

    y is up, as in glTF. An OBJ or STL file drawn with z up needs asset.rotate_deg=[-90,0,0]. `seed` is for the grain
    inside meshes and splats; above 0 it also shifts the particles of all objects but splats (`fracsim.asset.twin`).
    The lattice of interior particles is turned by `lattice_deg` [deg] about z, counter-clockwise.
    Raises ValueError, with the field, the value and the way out, for an object that cannot be used or needs more than
    asset.max_particles.
    """
    limits.check(asset, spacing)
    key = cache.key(asset, spacing, seed, lattice_deg)
    particles = cache.load(key)
    if particles is None:
        frame = LatticeFrame(lattice_deg)
        particles = frame.to_world(import_module(MODULES[asset.kind]).prepare(asset, spacing, seed, frame))
        limits.count(asset, spacing, len(particles))
        cache.store(key, particles)
    limits.count(asset, spacing, len(particles))
    return particles
