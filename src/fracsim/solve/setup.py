"""From a scene to what the solver takes: medium, boundary, and particles in the order of memory."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.backend import has_doubles
from fracsim.mpm.drive import Drive
from fracsim.mpm.grips import Grips
from fracsim.mpm.layout import order
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import State
from fracsim.mpm.timestep import require_stable
from fracsim.records import Particles
from fracsim.scene.vocab import CENTRE, Scene
from fracsim.solve.riders import moved
from fracsim.solve.uniaxial import rescaled_crit


class Ready(NamedTuple):
    """A scene that can be simulated."""

    medium: Medium
    """With the lambda_crit that the scene's cells need: it may differ from fracture.crit if fracture.length is set."""
    warnings: list[str]


def ready(scene: Scene) -> Ready:
    """The medium of a scene and warnings; needs Taichi, but no object.

    Raises ValueError for a precision, a substep or a `fracture.length` that cannot be used.
    """
    if scene.solver.precision == "float64" and not has_doubles(scene.backend):
        raise ValueError(
            f"solver.precision=float64 is not possible with backend.arch={scene.backend.arch}: use float32, or "
            "backend.arch=cpu or cuda."
        )
    given = medium(scene)
    warning = require_stable(given)
    crit = rescaled_crit(given, scene.fracture.length)
    return Ready(replace(given, fracture=replace(scene.fracture, crit=crit)), [warning] if warning else [])


def medium(scene: Scene) -> Medium:
    """Material, thresholds as given, numerics and gravity."""
    return Medium(scene.material, scene.fracture, scene.solver, tuple(scene.loading.gravity))


def grips(scene: Scene) -> Grips:
    """The two grips of a scene."""
    load = scene.loading
    return Grips(load.grips, load.axis, load.offset, load.thickness, load.speed, scene.solver.h,
                 scene.fracture.at_grips)  # fmt: skip


def in_memory_order(particles: Particles, h: float, frame: LatticeFrame = WORLD) -> Particles:
    """Particles in the order in which they lie in memory: neighbours in space are neighbours there.

    `frame` is that of the grid. Those without volume, which are drawn only, come last.
    """
    by = order((frame.points(particles.X) - np.asarray(CENTRE)) / h)
    by = by[np.argsort(particles.volume[by] == 0, kind="stable")]
    names = ("X", "volume", "covariance", "opacity", "sh", "surface")
    return replace(particles, **{name: getattr(particles, name)[by] for name in names})


def state(scene: Scene, particles: Particles) -> State:
    """The state at rest of particles between the grips of a scene.

    Raises ValueError where a grip holds nothing, or the grid is too large.
    """
    solid = moved(particles)
    drive = Drive.choose(scene.backend, len(solid), scene.solver.formulation)
    return State(medium(scene), solid, grips(scene), drive)


def wave_time(medium: Medium, length: float) -> float:
    """Time that a longitudinal wave takes through a bar of this length [m] and back [s]."""
    return 2 * length * math.sqrt(medium.material.density / medium.material.E)
