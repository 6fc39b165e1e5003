"""How substeps are launched on this machine."""

from typing import NamedTuple

from fracsim import backend
from fracsim.scene.vocab import Backend

CHUNK = {"total": 20_000, "updated": 4_000}
"""A second thread pays from this many particles on, a third from twice as many: starting a parallel loop costs time.
Particles of `total` are computed side by side, so that it takes more of them to make up for that."""


class Drive(NamedTuple):
    """The launches of a substep."""

    kind: str
    """`serial`, `threads` or `gpu` (see `fracsim.mpm.kernels`)."""
    threads: int = 1
    """Threads, each with a chunk of particles and a copy of the nodes; 1 on a GPU."""

    @classmethod
    def choose(cls, config: Backend, particles: int, formulation: str) -> "Drive":
        """The fastest drive for a number of particles and a solver.formulation on the running backend."""
        if not backend.on_cpu():
            return cls("gpu")
        threads = min(backend.threads(config), 1 + particles // CHUNK[formulation])
        return cls("serial" if threads == 1 else "threads", threads)
