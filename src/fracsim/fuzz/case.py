"""One scene of the study as plain data. It need not be valid, and is written to and read from YAML."""

import math
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from fracsim.fuzz.bodies import Body
from fracsim.mpm.state import State
from fracsim.mpm.timestep import stable_at_rest
from fracsim.records import Array
from fracsim.scene.program import SIMULATE
from fracsim.scene.vocab import Scene
from fracsim.solve.setup import medium

CALM, LIGHT = 0.3, 0.2
"""The solid can bear grips slower than CALM of the wave speed, and a weight below LIGHT of the stiffness."""


@dataclass(kw_only=True)
class Start:
    """The initial state, if it is not rest."""

    F: str = "rest"
    """rest, inverted (J < 0), flat (J = 0), stretched or random."""
    amount: float = 1.0
    """Stretch of `stretched`; size of the entries of `random`; depth of `inverted`."""
    share: float = 1.0
    """Part of the particles that get this F; the others have F = I."""
    speed: float = 0.0
    """Standard deviation of random velocities [m/s]."""
    seed: int = 0

    @property
    def resting(self) -> bool:
        """Whether the initial state is rest."""
        return self.F == "rest" and self.speed == 0

    def apply(self, state: State) -> None:
        """Overwrite F of the chosen particles and add random velocities to all."""
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
    """Case `number` of the study with `seed`: a scene, its object and its initial state."""

    family: str
    seed: int
    number: int
    scene: dict[str, Any]
    """Sections with the fields that differ from the default scene, not validated."""
    body: Body = field(default_factory=Body)
    start: Start = field(default_factory=Start)

    @property
    def name(self) -> str:
        """The name of the case's file, without suffix."""
        return f"{self.family}-{self.seed}-{self.number}"

    def resolve(self) -> Scene:
        """The validated scene; raises ValueError if it is not valid."""
        from omegaconf import OmegaConf

        return SIMULATE.resolve(OmegaConf.create(self.scene))


def sensible(case: Case, scene: Scene) -> bool:
    """Whether a scene must run to its end.

    Its substeps are chosen by the solver, it starts at rest, its grips are slower than CALM of the wave speed
    sqrt(E / density), the solid can bear its weight, and solver.max_speed is above the recoil of a torn piece (a few
    wave speeds). A stable substep exists, and the bulk modulus of a decoupled solid, lam, does not vanish.
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
        and stable_at_rest(medium(scene)) > 0  # 0 if RPIC damping per substep has r >= 2
        and (m.law != "neo_hookean_decoupled" or m.nu >= 0.05)
    )


def write(case: Case, path: Path, comment: str = "") -> None:
    """Write a case as YAML, after the lines of `comment`."""
    from omegaconf import OmegaConf

    path.parent.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"# {line}\n" for line in comment.splitlines())
    path.write_text(lines + OmegaConf.to_yaml(OmegaConf.create(asdict(case))), encoding="utf-8")


def read(path: Path) -> Case:
    """The case in a file; raises ValueError for a file without one."""
    from omegaconf import OmegaConf

    data: Any = OmegaConf.to_container(OmegaConf.load(path))
    known = {f.name for f in fields(Case)}
    if not isinstance(data, dict) or set(data) != known:
        raise ValueError(
            f"--replay {path} is no scene of this study: it must have the keys {', '.join(sorted(known))}."
        )
    return Case(**{**data, "body": Body(**data["body"]), "start": Start(**data["start"])})
