"""The time loop: how long the next substeps may be, how many, and a grid that follows."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from fracsim.mpm import params as slot
from fracsim.mpm.state import MARGIN, Peaks, State
from fracsim.mpm.timestep import GROWTH, ROTATION, limit, stable
from fracsim.scene.vocab import CENTRE

ROUND, LONG, CALM = 16, 48, 0.5
"""Substeps between two looks at the stability bound, unless a particle turns or stretches too much before: ROUND, or up
to LONG as long as no particle turns or stretches by more than CALM in them, at its present rate (`total`; not in the
first round, which finds out whether the start can be borne)."""

Hook = Callable[[float, float], None]
"""Called before a substep with its start [s] and its length [s], and with length 0 before a look at the bound."""


class SimulationError(RuntimeError):
    """The simulation left its limits; the message names particle, frame and field, and the likely cause."""


class Round(NamedTuple):
    """Substeps of equal length that have just been made."""

    n: int
    dt: float
    """[s]"""
    t: float
    """Time at the end [s]."""
    bound: float
    """Stability bound before a fixed dt [s]; infinite for solver.dt=auto, which respects it."""


class March:
    """Advances a state in rounds of substeps; remembers the last substep, from which the next may grow only slowly."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.dt = math.inf

    def rounds(self, t: float, duration: float, before: Hook | None = None) -> Iterator[Round]:
        """Make substeps from t to exactly t + duration [s]; yields after each round, before the grid follows.

        `before` is called before each substep. Raises SimulationError when the bound is not a number, or a particle
        flies off.
        """
        left = duration
        while left > 1e-9 * duration:
            if before is not None:
                before(t, 0.0)
            peaks = self.state.survey()
            dt, n, bound = self._choose(peaks, left)
            if before is not None and not self.state.total:  # no run is undone there, and what snaps is soon faster
                n = min(n, ROUND // 4)
            n = self._run(n, dt, t, before)
            t, left = t + n * dt, left - n * dt
            yield Round(n, dt, t, bound)
            if not self.state.total:
                self._follow()

    def _choose(self, peaks: Peaks, left: float) -> tuple[float, int, float]:
        """Length and number of the next substeps, and the bound; all substeps left are equally long."""
        medium, bound, first = self.state.medium, math.inf, math.isinf(self.dt)
        if isinstance(medium.solver.dt, str):
            most = limit(medium, peaks.stiffness, peaks.fastest, peaks.rate)
            self.dt = min(most, self.dt * GROWTH**ROUND)
        else:
            self.dt, bound = medium.solver.dt, stable(medium, peaks.stiffness)
        if not self.dt > 0:
            raise SimulationError(
                "the stability bound of solver.dt=auto is not a number (field F): the material has blown up. "
                "Use a smaller solver.safety."
            )
        steps = max(1, math.ceil(left / self.dt - 1e-6))
        dt = left / steps
        calm = CALM / (peaks.rate * dt) if self.state.total and peaks.rate > 0 and not first else 0.0
        longest = int(min(max(calm, ROUND), LONG))
        n = math.ceil(steps / math.ceil(steps / longest))  # rounds of equal length, none of a single substep
        if not self.state.total and peaks.fastest > 0:  # particles must not leave the nodes in use
            n = min(n, max(1, int(MARGIN / 2 * medium.h / (peaks.fastest * dt))))
        return dt, n, bound

    def _run(self, n: int, dt: float, t: float, before: Hook | None) -> int:
        """Run n substeps; returns how many were made: fewer where a particle turned or stretched too much."""
        if before is not None:
            for k in range(n):
                before(t + k * dt, dt)
                self.state.run(1, dt, t + k * dt)
            return n
        turn = 2 * ROTATION if isinstance(self.state.medium.solver.dt, str) else math.inf
        if self.state.total:
            return self.state.run(n, dt, t, turn)
        return self._run_updated(n, dt, t, turn)

    def _run_updated(self, n: int, dt: float, t: float, turn: float) -> int:
        """In `updated`, run fewer substeps where a particle would have left the nodes in use.

        Where the grid lets go, particles are suddenly as fast as the waves.
        """
        self.state.save()
        made = self.state.run(n, dt, t, turn)
        while made > 1 and self.state.fault()[0] == slot.GRID_FAULT:
            self.state.restore()
            made = self.state.run(max(1, made // 4), dt, t, turn)
        return made

    def _follow(self) -> None:
        """In `updated`, lay out the grid again once a particle has moved by a cell."""
        s = self.state
        U = s.points.U.to_numpy()
        if float(np.abs(U - s.points.anchor.to_numpy()).max()) > MARGIN / 2 * s.medium.h:
            x = s.X0 + U
            try:
                s.relayout(x)
            except ValueError as error:
                p = int(np.abs(x).max(axis=1).argmax())
                raise SimulationError(
                    f"particle {p} has flown off to {(x[p] + np.asarray(CENTRE)).round(2)} m (field x): {error}"
                ) from error
