"""This project's substep of the bar, pulled by grips as in the default scene."""

import numpy as np

from fracsim.bench import bar
from fracsim.mpm.layout import order
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Backend, Scene, Solver
from fracsim.solve import setup


class Ours:
    """The bar in a `State`."""

    def __init__(
        self, X: Array, v: Array, cells: int, law: str, pressure: str, threads: int, lanes: bool = True
    ) -> None:
        """Positions X (N, 3) [m] and velocities v (N, 3) [m/s]; `cells` along the domain.

        `pressure` is solver.pressure, `threads` is backend.threads; without `lanes` particles are computed one by one.
        """
        solver = Solver(cells=cells, pressure=pressure, damping="per_substep")
        scene = Scene(material=bar.material(law), solver=solver, backend=Backend(threads=threads))
        by = order((X - np.asarray(CENTRE)) / solver.h)
        self.state = setup.state(scene, particles(X[by], solver.spacing))
        self.state.points.V.from_numpy(v[by])
        if not lanes:
            self.state.lanes = None

    def __len__(self) -> int:
        return self.state.n

    def run(self, substeps: int) -> None:
        """Advance by `substeps` of length DT."""
        self.state.run(substeps, bar.DT, 0.0)


def particles(X: Array, spacing: float) -> Particles:
    """Particles of equal volume at X (N, 3) [m]; their look plays no part in the substep."""
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
