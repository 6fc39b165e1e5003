"""When a scene is predicted to break: as a uniform bar as long as the gauge between its grips.

The bar parts at the peak of its load (`fracsim.solve.uniaxial`). An object that is thinner or thicker between the
grips than under them breaks earlier or later, and a fast pull breaks later than a slow one.
"""

import json
import math
from dataclasses import asdict
from functools import lru_cache

from fracsim.scene.vocab import Fracture, Material, Scene, Solver


def breaking_stretch(scene: Scene) -> float:
    """Nominal stretch at which a uniform bar of the scene's material breaks on the scene's cells; starts Taichi."""
    from fracsim import backend

    backend.start(scene.backend)
    return _breaks_at(json.dumps([asdict(scene.material), asdict(scene.fracture), asdict(scene.solver)]))


@lru_cache(maxsize=4096)
def _breaks_at(medium: str) -> float:
    """The same for material, fracture and solver as JSON."""
    from fracsim.mpm.medium import Medium
    from fracsim.solve.uniaxial import rescaled_crit, uniaxial_bar

    material, fracture, solver = json.loads(medium)
    given = Medium(Material(**material), Fracture(**fracture), Solver(**solver))
    return uniaxial_bar(given, rescaled_crit(given, given.fracture.length)).breaks_at


def breaking_frame(scene: Scene, stretch: float) -> int:
    """The first frame in which the nominal stretch between the grips has reached `stretch`.

    It may lie beyond the last one: frame = (stretch - 1) gauge / (2 speed) fps, rounded up.
    """
    seconds = (stretch - 1) * scene.loading.gauge / (2 * scene.loading.speed)
    return math.ceil(seconds * scene.capture.fps - 1e-9)
