"""Which scene is number k of a study: drawn from the seed and k alone, so always the same one.

A scene belongs to a family. All fields are drawn moderately, then the family pushes its own to their ends. Duration
follows from the number of substeps that a scene may cost, not from what a film would want.
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
"""Particles times substeps of a scene: about 0.3 s."""
LONG = 100_000
"""Substeps of a long run."""
FASTEST = 2e4
"""Waves faster than this [m/s] recoil beyond the largest solver.max_speed."""


def draw(seed: int, number: int) -> Case:
    """Case `number` of the study with `seed`."""
    family = CYCLE[number % len(CYCLE)]
    d = Draft(family, seed, number)
    _moderate(d)
    FAMILIES[family](d)
    _grips(d)
    _speed(d)
    if family in LATE:
        LATE[family](d)
    _duration(d)
    return d.case


def _moderate(d: Draft) -> None:
    """Every field within what a user would try."""
    d.set("material.law", d.choose(*registry.names("fracsim.constitutive")))
    d.set("material.E", d.log(1e3, 1e6))
    d.set("material.nu", d.uniform(0.0, 0.45))
    d.set("material.density", d.log(100, 2000))
    onset = d.uniform(1.2, 3.0)
    d.set("fracture.onset", onset)
    d.set("fracture.crit", round(onset + d.uniform(0.2, 1.0), 6))
    d.set("fracture.at_grips", bool(d.rng.random() < 0.25))
    d.set("loading.grips", d.choose("rigid", "sliding", "soft"))
    d.set("loading.axis_deg", d.choose(0.0, 0.0, d.uniform(-20, 20)))
    d.set("solver.formulation", d.choose("total", "updated"))
    d.set("solver.cells", int(d.rng.integers(30, 80)))
    d.set("solver.particles_per_axis", 2.0)
    d.set("solver.pressure", "auto" if d.case.number % 3 else "particle")
    d.set("solver.precision", d.choose("float32", "float32", "float32", "float64"))
    d.set("solver.max_speed", d.choose(500.0, 1e5, 1e5))
    if d.rng.random() < 0.5:
        h = 2.0 / d.get("solver.cells")
        dt = h * math.sqrt(d.get("material.density") / (3 * d.get("material.E")))
        full = d.get("material.density") * h**2 / (4 * dt)  # what RPIC damping of r = 1 is at about this substep
        d.set("material.viscosity", float(f"{min(d.uniform(0, 0.5) * full, 1e3):.6g}"))
        d.set("material.decay", d.uniform(0, 5))
    d.set("backend.threads", 1)
    d.counts((16, 28), (4, 8), (4, 8))
    d.case.body.shift = [d.uniform(-0.5, 0.5) for _ in range(3)]


def _grips(d: Draft) -> None:
    """Grips well inside the object, unless the family has chosen others."""
    if "offset" not in d.case.scene["loading"]:
        d.set("loading.offset", float(f"{min(d.uniform(0.25, 0.4) * d.length, 1.0):.6g}"))
    if "thickness" not in d.case.scene["loading"]:
        d.set("loading.thickness", float(f"{min(max(d.uniform(0.1, 0.2) * d.length, 1.2 * d.spacing), 1.0):.6g}"))


def _speed(d: Draft) -> None:
    """Grips slower than the material's waves, unless the family has chosen another speed."""
    if "speed" not in d.case.scene["loading"]:
        d.set("loading.speed", float(f"{min(max(d.log(0.01, 0.25) * d.wave, 0.01), 20.0):.6g}"))


def _material(d: Draft) -> None:
    """E, nu and density over all they may be."""
    d.set("material.E", d.log(1e3, 1e9))
    d.set("material.nu", d.choose(0.0, 0.499, d.uniform(0, 0.499), d.uniform(0.45, 0.499)))
    d.set("material.density", d.log(1, 2e4))
    while d.wave > FASTEST:
        d.set("material.density", min(3 * d.get("material.density"), 2e4))


def _thresholds(d: Draft) -> None:
    """Damage from the first strain on, or hardly ever, and from whole to failed in a moment."""
    onset = d.choose(1.001, d.log(1.001, 10), d.log(1.001, 10), 1.0)
    narrow = d.choose(1e-4, 1e-3, d.log(1e-3, 1), d.log(0.1, 5))
    d.set("fracture.onset", onset)
    d.set("fracture.crit", min(float(f"{onset + narrow:.8g}"), 10.0))
    if d.rng.random() < 0.08:
        d.set("fracture.crit", max(onset, 1.001))
        d.set("fracture.onset", max(onset, 1.001))
    d.set("material.nu", d.uniform(0, 0.49))


def _held(d: Draft) -> None:
    """Grips at the ends that hardly hold anything, that touch, that hold nearly all; any axis."""
    d.set("loading.axis_deg", d.choose(0.0, 90.0, 45.0, -135.0, d.uniform(-360, 360)))
    length, spacing = d.extent(d.get("loading.axis_deg")), d.spacing
    how = d.choose("ends", "touching", "all", "overlapping", "any")
    thickness = {"ends": spacing, "touching": 0.4 * length, "all": 0.45 * length, "overlapping": 0.5 * length,
                 "any": d.log(0.2 * spacing, length)}[how]  # fmt: skip
    offset = {"ends": length / 2, "touching": thickness / 2 * 1.0001, "all": 0.26 * length,
              "overlapping": 0.24 * length, "any": d.uniform(0, 0.6) * length}[how]  # fmt: skip
    d.set("loading.thickness", float(f"{min(thickness, 1.0):.6g}"))
    d.set("loading.offset", float(f"{min(offset, 1.0):.6g}"))


def _damping(d: Draft) -> None:
    """Viscosity and decay from nothing to far too much, in every mode."""
    d.set("solver.damping", d.choose("physical", "physical", "per_substep", "none"))
    d.set("material.viscosity", d.choose(0.0, d.log(1e-3, 1e3), d.log(1, 1e3)))
    d.set("material.decay", d.choose(0.0, d.log(1e-2, 1e3), 1e3))


def _gravity(d: Draft) -> None:
    """Weight in any direction, up to what crushes the object."""
    g = d.choose(9.81, d.log(0.1, 1e3), 1e3)
    way = d.rng.normal(size=3)
    d.set("loading.gravity", [float(f"{g * u / np.linalg.norm(way):.6g}") for u in way])


def _resolution(d: Draft) -> None:
    """Few large cells, many small ones, particles that are one a cell or do not fit it."""
    d.set("solver.cells", d.choose(8, 16, 150, 400, 2000))
    d.set("solver.particles_per_axis", d.choose(1.0, 1.5, 3.0, 3.7, 8.0))
    d.set("solver.precision", d.choose("float32", "float64"))
    if d.get("solver.particles_per_axis") > 3:
        d.counts((24, 40), (5, 8), (5, 8))


def _bodies(d: Draft) -> None:
    """Plates and wires one particle thick, specks, blocks that touch, hardly touch or do not, clouds, shells."""
    kind = d.choose("plate", "wire", "speck", "touching", "disjoint", "bridged", "cloud", "hollow")
    d.case.body.kind = "bar" if kind in ("plate", "wire", "speck") else kind
    d.case.body.seed = int(d.rng.integers(2**31))
    shape = {"plate": ((16, 28), (8, 16), (1, 1)), "wire": ((16, 60), (1, 2), (1, 2)), "hollow": ((14, 20),) * 3}
    if kind in shape:
        d.counts(*shape[kind])
    if kind == "speck":
        d.case.body.counts = list(d.choose([1, 1, 1], [2, 1, 1], [2, 2, 2], [3, 1, 1], [4, 2, 1]))
        d.case.body.shift = [0.0, 0.0, 0.0]
        d.set("loading.offset", float(f"{0.5 * d.length:.6g}"))
        d.set("loading.thickness", float(f"{0.7 * d.length:.6g}"))


def _start(d: Draft) -> None:
    """F inverted, flat, hugely stretched or random, in one particle, some or all; or random velocities."""
    F = d.choose("inverted", "flat", "stretched", "random", "rest")
    amount = {"stretched": d.log(1.5, 50), "inverted": d.log(1e-3, 2), "random": d.log(1e-3, 3)}.get(F, 1.0)
    speed = d.log(1e-3, 1) * d.wave if F == "rest" else 0.0
    share = d.choose(0.01, 0.2, 1.0)
    d.case.start = Start(F=F, amount=amount, share=share, speed=speed, seed=int(d.rng.integers(2**31)))


def _long(d: Draft) -> None:
    """A speck for a hundred thousand substeps, slow enough that it is not torn long before."""
    d.case.body.counts = list(d.choose([4, 2, 2], [4, 1, 1], [6, 2, 2]))
    d.case.body.shift = [0.0, 0.0, 0.0]
    d.set("loading.axis_deg", 0.0)
    d.set("loading.offset", float(f"{d.length / 2:.6g}"))
    d.set("loading.thickness", float(f"{1.1 * d.spacing:.6g}"))
    d.set("loading.speed", 0.01)
    d.set("material.E", d.log(1e5, 1e8))
    d.steps = LONG


def _fixed_dt(d: Draft) -> None:
    """A fixed substep from half to twice the stability bound at rest."""
    d.dt_factor = d.choose(0.5, 0.9, 1.01, 2.0, d.uniform(0.5, 2.0))
    d.set("solver.dt_override", bool(d.rng.random() < 0.8))
    d.set("material.viscosity", 0.0)


def _violent(d: Draft) -> None:
    """Speeds up to 20 m/s, whatever the solid can follow."""
    d.set("loading.speed", d.choose(20.0, d.log(0.01, 20), d.log(1, 20)))
    d.set("material.E", d.log(1e3, 1e7))


def _wild(d: Draft) -> None:
    """All of it at once."""
    for push in (_material, _thresholds, _damping, _gravity, _resolution, _bodies, _violent):
        if d.rng.random() < 0.5:
            push(d)
    d.set("material.nu", d.uniform(0, 0.499))
    if d.rng.random() < 0.3:
        d.set("solver.safety", 1.0)
    if d.get("solver.formulation") == "updated" and d.rng.random() < 0.2:
        d.set("solver.walls", True)


FAMILIES: dict[str, Callable[[Draft], None]] = {
    "material": _material,
    "thresholds": _thresholds,
    "grips": lambda d: None,
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
LATE: dict[str, Callable[[Draft], None]] = {"grips": _held}
"""What needs the length of the object."""
CYCLE = (
    "material", "thresholds", "grips", "damping", "bodies", "start", "fixed_dt", "wild", "gravity", "resolution",
    "violent", "material", "bodies", "thresholds", "grips", "start", "damping", "wild", "long", "resolution",
    "fixed_dt", "bodies", "material", "wild", "start",
)  # fmt: skip
"""Number k belongs to family k modulo the length of this: each is drawn often enough, the slow ones seldom."""


def _duration(d: Draft) -> None:
    """Frames and frame rate: until the object should have parted, or as long as the scene may cost."""
    d.set("capture.frames", int(d.rng.integers(4, 9)))
    d.set("capture.fps", 100.0)
    try:
        scene = d.case.resolve()
    except ValueError:  # refused later on, by the run
        return
    if d.dt_factor:
        d.set("solver.dt", float(f"{d.dt_factor * stable_at_rest(medium(scene)):.6g}"))
        scene.solver.dt = d.get("solver.dt")
    n, load = len(build(d.case.body, scene.solver)), scene.loading
    auto = limit(medium(scene), rest_stiffness(medium(scene)), load.speed, 0.0)
    dt = float(scene.solver.dt) if d.dt_factor else auto
    part = 1.3 * (scene.fracture.crit - 1) * load.gauge / (2 * load.speed)
    steps = d.steps or min(max(part / dt, 30), max(COST / n, 30), 3000)
    fps = (d.get("capture.frames") - 1) / (steps * dt)
    if fps < 1:
        d.set("capture.frames", 1 + max(1, round(steps * dt)))
    d.set("capture.fps", float(f"{min(max(fps, 1.0), 1e5):.6g}"))
