"""This project's substep on the bar, nothing held by grips."""

import numpy as np

from fracsim.bench import bar
from fracsim.mpm import params as slot
from fracsim.mpm.layout import order
from fracsim.mpm.state import State
from fracsim.records import Array, Particles
from fracsim.vocab import CENTRE, Backend, Scene, Solver


class Ours:
    """The particles of a bar in a `State`; `threads` as in Backend, 0 = all cores."""

    def __init__(
        self, X: Array, v: Array, cells: int, law: str = "fixed_corotated", formulation: str = "total", threads: int = 0
    ) -> None:
        solver = Solver(cells=cells, formulation=formulation, damping="per_substep")
        scene = Scene(material=bar.material(law), solver=solver, backend=Backend(threads=threads))
        self.order = order((X - np.asarray(CENTRE)) / solver.h)
        self.state = State(scene, _particles(X[self.order], solver.spacing))
        self.state.K[slot.HALF] = -1.0  # grips hold no node
        self.state.label.from_numpy(np.full(len(X), slot.FREE, np.int32))
        self.state.V.from_numpy(v[self.order])

    def __len__(self) -> int:
        return len(self.order)

    def run(self, substeps: int) -> None:
        """Advance by substeps of length DT."""
        self.state.run(substeps, bar.DT, 0.0)

    def positions(self) -> Array:
        """Present positions [m], (N, 3), in the order given."""
        out = np.empty((len(self.order), 3))
        out[self.order] = self.state.X0.astype(np.float64) + self.state.U.to_numpy() + np.asarray(CENTRE)
        return out


def _particles(X: Array, spacing: float) -> Particles:
    """Particles of equal volume; how they look has no part in the substep."""
    n = len(X)
    return Particles(
        X=X,
        volume=np.full(n, spacing**3, np.float32),
        covariance=np.zeros((n, 6), np.float32),
        opacity=np.zeros(n, np.float32),
        sh=np.zeros((n, 1, 3), np.float32),
        surface=np.zeros(n, bool),
        spacing=spacing,
    )
