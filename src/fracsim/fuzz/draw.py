"""Draws scene number k of a study, from the seed and k alone.

Each scene belongs to a family. First all fields are drawn from moderate ranges. Then the family draws its own fields
from their full ranges. The duration follows from the number of substeps that a scene may cost.
"""

import math
from collections.abc import Callable

import numpy as np

from fracsim import registry
from fracsim.fuzz.bodies import build
from fracsim.fuzz.case import Case, Start
from fracsim.fuzz.draft import Draft
from fracsim.mpm.timestep import limit, rest_stiffness, stable_at_rest
from fracsim.solve.setup import medium

COST = 6e5
"""Particles times substeps of a scene, about 0.3 s."""
LONG = 100_000
"""Substeps of a long run."""
FASTEST = 2e4
"""Wave speed [m/s] above which the recoil exceeds the largest solver.max_speed."""


def draw(seed: int, number: int) -> Case:
    """Case `number` of the study with `seed`."""
    family = CYCLE[number % len(CYCLE)]
    draft = Draft(family, seed, number)
    _moderate(draft)
    FAMILIES[family](draft)
    _grips(draft)
    _speed(draft)
    if family in LATE:
        LATE[family](draft)
    _duration(draft)
    return draft.case


def _moderate(draft: Draft) -> None:
    """All fields, from ranges that a user would try."""
    draft.set("material.law", draft.choose(*registry.names("fracsim.constitutive")))
    draft.set("material.E", draft.log(1e3, 1e6))
    draft.set("material.nu", draft.uniform(0.0, 0.45))
    draft.set("material.density", draft.log(100, 2000))
    onset = draft.uniform(1.2, 3.0)
    draft.set("fracture.onset", onset)
    draft.set("fracture.crit", round(onset + draft.uniform(0.2, 1.0), 6))
    draft.set("fracture.at_grips", bool(draft.rng.random() < 0.25))
    draft.set("loading.grips", draft.choose("rigid", "sliding", "soft"))
    draft.set("loading.axis_deg", draft.choose(0.0, 0.0, draft.uniform(-20, 20)))
    draft.set("solver.formulation", draft.choose("total", "updated"))
    draft.set("solver.cells", int(draft.rng.integers(30, 80)))
    draft.set("solver.particles_per_axis", 2.0)
    draft.set("solver.pressure", "auto" if draft.case.number % 3 else "particle")
    draft.set("solver.precision", draft.choose("float32", "float32", "float32", "float64"))
    draft.set("solver.max_speed", draft.choose(500.0, 1e5, 1e5))
    if draft.rng.random() < 0.5:
        h = 2.0 / draft.get("solver.cells")
        dt = h * math.sqrt(draft.get("material.density") / (3 * draft.get("material.E")))
        largest = draft.get("material.density") * h**2 / (4 * dt)  # RPIC damping with r = 1 at about this substep
        draft.set("material.viscosity", float(f"{min(draft.uniform(0, 0.5) * largest, 1e3):.6g}"))
        draft.set("material.decay", draft.uniform(0, 5))
    draft.set("backend.threads", 1)
    draft.counts((16, 28), (4, 8), (4, 8))
    draft.case.body.shift = [draft.uniform(-0.5, 0.5) for _ in range(3)]


def _grips(draft: Draft) -> None:
    """Grips well inside the object, unless the family has set them."""
    if "offset" not in draft.case.scene["loading"]:
        draft.set("loading.offset", float(f"{min(draft.uniform(0.25, 0.4) * draft.length, 1.0):.6g}"))
    if "thickness" not in draft.case.scene["loading"]:
        thickness = max(draft.uniform(0.1, 0.2) * draft.length, 1.2 * draft.spacing)
        draft.set("loading.thickness", float(f"{min(thickness, 1.0):.6g}"))


def _speed(draft: Draft) -> None:
    """Grips slower than the waves, unless the family has set the speed."""
    if "speed" not in draft.case.scene["loading"]:
        draft.set("loading.speed", float(f"{min(max(draft.log(0.01, 0.25) * draft.wave, 0.01), 20.0):.6g}"))


def _material(draft: Draft) -> None:
    """E, nu and density over their full ranges."""
    draft.set("material.E", draft.log(1e3, 1e9))
    draft.set("material.nu", draft.choose(0.0, 0.499, draft.uniform(0, 0.499), draft.uniform(0.45, 0.499)))
    draft.set("material.density", draft.log(1, 2e4))
    while draft.wave > FASTEST:
        draft.set("material.density", min(3 * draft.get("material.density"), 2e4))


def _thresholds(draft: Draft) -> None:
    """Damage from the first strain on, or hardly ever; thresholds far apart or almost equal."""
    onset = draft.choose(1.001, draft.log(1.001, 10), draft.log(1.001, 10), 1.0)
    narrow = draft.choose(1e-4, 1e-3, draft.log(1e-3, 1), draft.log(0.1, 5))
    draft.set("fracture.onset", onset)
    draft.set("fracture.crit", min(float(f"{onset + narrow:.8g}"), 10.0))
    if draft.rng.random() < 0.08:
        draft.set("fracture.crit", max(onset, 1.001))
        draft.set("fracture.onset", max(onset, 1.001))
    draft.set("material.nu", draft.uniform(0, 0.49))


def _grip_extremes(draft: Draft) -> None:
    """Grips that hold hardly anything, that touch or overlap, that hold nearly everything; any axis."""
    draft.set("loading.axis_deg", draft.choose(0.0, 90.0, 45.0, -135.0, draft.uniform(-360, 360)))
    length, spacing = draft.extent(draft.get("loading.axis_deg")), draft.spacing
    how = draft.choose("ends", "touching", "all", "overlapping", "any")
    thickness = {"ends": spacing, "touching": 0.4 * length, "all": 0.45 * length, "overlapping": 0.5 * length,
                 "any": draft.log(0.2 * spacing, length)}[how]  # fmt: skip
    offset = {"ends": length / 2, "touching": thickness / 2 * 1.0001, "all": 0.26 * length,
              "overlapping": 0.24 * length, "any": draft.uniform(0, 0.6) * length}[how]  # fmt: skip
    draft.set("loading.thickness", float(f"{min(thickness, 1.0):.6g}"))
    draft.set("loading.offset", float(f"{min(offset, 1.0):.6g}"))


def _damping(draft: Draft) -> None:
    """Viscosity and decay from zero to far too much, in every mode."""
    draft.set("solver.damping", draft.choose("physical", "physical", "per_substep", "none"))
    draft.set("material.viscosity", draft.choose(0.0, draft.log(1e-3, 1e3), draft.log(1, 1e3)))
    draft.set("material.decay", draft.choose(0.0, draft.log(1e-2, 1e3), 1e3))


def _gravity(draft: Draft) -> None:
    """Gravity in any direction, up to a weight that crushes the object."""
    g = draft.choose(9.81, draft.log(0.1, 1e3), 1e3)
    direction = draft.rng.normal(size=3)
    draft.set("loading.gravity", [float(f"{g * u / np.linalg.norm(direction):.6g}") for u in direction])


def _resolution(draft: Draft) -> None:
    """Few large cells or many small ones; one particle a cell, or a number that is not whole along an axis."""
    draft.set("solver.cells", draft.choose(8, 16, 150, 400, 2000))
    draft.set("solver.particles_per_axis", draft.choose(1.0, 1.5, 3.0, 3.7, 8.0))
    draft.set("solver.precision", draft.choose("float32", "float64"))
    if draft.get("solver.particles_per_axis") > 3:
        draft.counts((24, 40), (5, 8), (5, 8))


def _bodies(draft: Draft) -> None:
    """Plates and wires one or two particles thick, specks, two blocks (touching, bridged, separate), clouds, shells."""
    kind = draft.choose("plate", "wire", "speck", "touching", "disjoint", "bridged", "cloud", "hollow")
    draft.case.body.kind = "bar" if kind in ("plate", "wire", "speck") else kind
    draft.case.body.seed = int(draft.rng.integers(2**31))
    shape = {"plate": ((16, 28), (8, 16), (1, 1)), "wire": ((16, 60), (1, 2), (1, 2)), "hollow": ((14, 20),) * 3}
    if kind in shape:
        draft.counts(*shape[kind])
    if kind == "speck":
        draft.case.body.counts = list(draft.choose([1, 1, 1], [2, 1, 1], [2, 2, 2], [3, 1, 1], [4, 2, 1]))
        draft.case.body.shift = [0.0, 0.0, 0.0]
        draft.set("loading.offset", float(f"{0.5 * draft.length:.6g}"))
        draft.set("loading.thickness", float(f"{0.7 * draft.length:.6g}"))


def _start(draft: Draft) -> None:
    """F inverted, flat, hugely stretched or random, in few, some or all particles; or random velocities."""
    F = draft.choose("inverted", "flat", "stretched", "random", "rest")
    amount = {"stretched": draft.log(1.5, 50), "inverted": draft.log(1e-3, 2), "random": draft.log(1e-3, 3)}.get(F, 1.0)
    speed = draft.log(1e-3, 1) * draft.wave if F == "rest" else 0.0
    share = draft.choose(0.01, 0.2, 1.0)
    draft.case.start = Start(F=F, amount=amount, share=share, speed=speed, seed=int(draft.rng.integers(2**31)))


def _long(draft: Draft) -> None:
    """A speck for a hundred thousand substeps, pulled so slowly that it does not tear long before the end."""
    draft.case.body.counts = list(draft.choose([4, 2, 2], [4, 1, 1], [6, 2, 2]))
    draft.case.body.shift = [0.0, 0.0, 0.0]
    draft.set("loading.axis_deg", 0.0)
    draft.set("loading.offset", float(f"{draft.length / 2:.6g}"))
    draft.set("loading.thickness", float(f"{1.1 * draft.spacing:.6g}"))
    draft.set("loading.speed", 0.01)
    draft.set("material.E", draft.log(1e5, 1e8))
    draft.steps = LONG


def _fixed_dt(draft: Draft) -> None:
    """A fixed substep from half to twice the stability bound at rest."""
    draft.dt_factor = draft.choose(0.5, 0.9, 1.01, 2.0, draft.uniform(0.5, 2.0))
    draft.set("solver.dt_override", bool(draft.rng.random() < 0.8))
    draft.set("material.viscosity", 0.0)


def _violent(draft: Draft) -> None:
    """Grip speeds up to 20 m/s, also beyond the wave speed."""
    draft.set("loading.speed", draft.choose(20.0, draft.log(0.01, 20), draft.log(1, 20)))
    draft.set("material.E", draft.log(1e3, 1e7))


def _wild(draft: Draft) -> None:
    """Several families at once."""
    for push in (_material, _thresholds, _damping, _gravity, _resolution, _bodies, _violent):
        if draft.rng.random() < 0.5:
            push(draft)
    draft.set("material.nu", draft.uniform(0, 0.499))
    if draft.rng.random() < 0.3:
        draft.set("solver.safety", 1.0)
    if draft.get("solver.formulation") == "updated" and draft.rng.random() < 0.2:
        draft.set("solver.walls", True)
        draft.set("solver.lattice", "world")


FAMILIES: dict[str, Callable[[Draft], None]] = {
    "material": _material,
    "thresholds": _thresholds,
    "grips": lambda draft: None,
    "damping": _damping,
    "gravity": _gravity,
    "resolution": _resolution,
    "bodies": _bodies,
    "start": _start,
    "long": _long,
    "fixed_dt": _fixed_dt,
    "violent": _violent,
    "wild": _wild,
}
LATE: dict[str, Callable[[Draft], None]] = {"grips": _grip_extremes}
"""Families that need the length of the object, so that they come last."""
CYCLE = (
    "material", "thresholds", "grips", "damping", "bodies", "start", "fixed_dt", "wild", "gravity", "resolution",
    "violent", "material", "bodies", "thresholds", "grips", "start", "damping", "wild", "long", "resolution",
    "fixed_dt", "bodies", "material", "wild", "start",
)  # fmt: skip
"""Scene k belongs to family CYCLE[k modulo its length]. Slow families are rarer."""


def _duration(draft: Draft) -> None:
    """Frames and frame rate: up to the expected break, or as long as the cost allows."""
    draft.set("capture.frames", int(draft.rng.integers(4, 9)))
    draft.set("capture.fps", 100.0)
    try:
        scene = draft.case.resolve()
    except ValueError:  # the run will refuse it
        return
    if draft.dt_factor:
        draft.set("solver.dt", float(f"{draft.dt_factor * stable_at_rest(medium(scene)):.6g}"))
        scene.solver.dt = draft.get("solver.dt")
    n, load = len(build(draft.case.body, scene.solver)), scene.loading
    auto = limit(medium(scene), rest_stiffness(medium(scene)), load.speed, 0.0)
    dt = float(scene.solver.dt) if draft.dt_factor else auto
    if dt == 0:  # viscosity per substep so large that no substep is stable
        return
    part = 1.3 * (scene.fracture.crit - 1) * load.gauge / (2 * load.speed)
    steps = draft.steps or min(max(part / dt, 30), max(COST / n, 30), 3000)
    fps = (draft.get("capture.frames") - 1) / (steps * dt)
    if fps < 1:
        draft.set("capture.frames", 1 + max(1, round(steps * dt)))
    draft.set("capture.fps", float(f"{min(max(fps, 1.0), 1e5):.6g}"))
