"""One scene of the study as plain data, so that it can be written to a file before anyone has validated it."""

import math
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from fracsim.fuzz.bodies import Body
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.program import SIMULATE
from fracsim.scene.vocab import Scene

CALM, LIGHT = 0.3, 0.2
"""A grip slower than this part of the wave speed, and a weight below this part of the stiffness, ask for nothing that
the solid cannot do."""


@dataclass(kw_only=True)
class Start:
    """The state at t = 0 that replaces rest in a part of the particles."""

    F: str = "rest"
    """rest, inverted (J < 0), flat (J = 0), stretched or random."""
    amount: float = 1.0
    """Stretch of `stretched`; size of the entries of `random`; depth of `inverted`."""
    share: float = 1.0
    """Part of the particles that start so; the others are at rest."""
    speed: float = 0.0
    """Standard deviation of random velocities [m/s]."""
    seed: int = 0

    @property
    def resting(self) -> bool:
        """Whether nothing is changed."""
        return self.F == "rest" and self.speed == 0

    def apply(self, state: State) -> None:
        """Overwrite F and add to v of a state."""
        if self.resting:
            return
        rng = np.random.default_rng(self.seed)
        F, V = state.points.F.to_numpy(), state.points.V.to_numpy()
        chosen = rng.random(state.n) < self.share
        F[chosen] = self._gradients(int(chosen.sum()), rng)
        state.points.F.from_numpy(F.astype(state.dtype))
        state.points.V.from_numpy((V + self.speed * rng.normal(size=V.shape)).astype(state.dtype))

    def _gradients(self, n: int, rng: np.random.Generator) -> Array:
        """Deformation gradients, (n, 3, 3)."""
        if self.F == "random":
            return np.eye(3) + self.amount * rng.normal(size=(n, 3, 3))
        stretch = {"rest": 1.0, "flat": 0.0, "inverted": -self.amount, "stretched": self.amount}[self.F]
        Q = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
        out: Array = Q @ (np.array([stretch, 1.0, 1.0])[:, None] * np.swapaxes(Q, 1, 2))
        return out


@dataclass(kw_only=True)
class Case:
    """A scene, the object that is pulled, and how it starts; number `number` of the study with `seed`."""

    family: str
    seed: int
    number: int
    scene: dict[str, Any]
    """Sections and fields that differ from the default scene, not validated."""
    body: Body = field(default_factory=Body)
    start: Start = field(default_factory=Start)

    @property
    def name(self) -> str:
        """The name of its file."""
        return f"{self.family}-{self.seed}-{self.number}"

    def resolve(self) -> Scene:
        """The validated scene; raises ValueError for one that is not allowed."""
        from omegaconf import OmegaConf

        return SIMULATE.resolve(OmegaConf.create(self.scene))


def sensible(case: Case, scene: Scene) -> bool:
    """Whether a scene must run to its end: substeps chosen by the solver, a start at rest, grips slower than CALM of
    the wave speed sqrt(E / density) where it is slowest, a weight that the solid can bear, and a speed limit that the
    recoil of a torn piece (some wave speeds) does not reach. A decoupled solid, whose lam is its bulk modulus,
    must resist a change of volume at all.
    """
    m, length = scene.material, max(case.body.counts) * scene.solver.spacing
    wave = math.sqrt(m.E / m.density)
    weight = math.hypot(*scene.loading.gravity) * m.density * length / m.E
    return (
        scene.solver.dt == "auto"
        and case.start.resting
        and scene.loading.speed <= CALM * wave
        and weight <= LIGHT
        and scene.solver.max_speed >= 5 * wave
        and (m.law != "neo_hookean_decoupled" or m.nu >= 0.05)
    )


def write(case: Case, path: Path, told: str = "") -> None:
    """Keep a case as YAML; `told` becomes a comment."""
    from omegaconf import OmegaConf

    path.parent.mkdir(parents=True, exist_ok=True)
    comment = "".join(f"# {line}\n" for line in told.splitlines())
    path.write_text(comment + OmegaConf.to_yaml(OmegaConf.create(asdict(case))), encoding="utf-8")


def read(path: Path) -> Case:
    """The case in a file; raises ValueError when it is none."""
    from omegaconf import OmegaConf

    data: Any = OmegaConf.to_container(OmegaConf.load(path))
    known = {f.name for f in fields(Case)}
    if not isinstance(data, dict) or set(data) != known:
        raise ValueError(
            f"--replay {path} is no scene of this study: it must have the keys {', '.join(sorted(known))}."
        )
    return Case(**{**data, "body": Body(**data["body"]), "start": Start(**data["start"])})
