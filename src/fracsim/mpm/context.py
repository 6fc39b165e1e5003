"""What the Taichi functions of a substep see, in bundles. The compiler resolves them: passing them costs nothing.

Arrays of particles and nodes are listed here with shapes and units, and once more as the arguments of the one kernel
that takes them (`fracsim.mpm.kernels`).
"""

from types import ModuleType
from typing import Any, NamedTuple

from fracsim.mpm.tally import Tally
from fracsim.mpm.transfer import Grid


class Variant(NamedTuple):
    """What a kernel is compiled for."""

    law: ModuleType
    """A module of fracsim.constitutive."""
    damage: ModuleType
    """A module of fracsim.damage."""
    total: bool
    """Weights from the rest configuration; else from the present one."""
    cellwise: bool
    """The particles of a cell share one pressure (`fracsim.mpm.dilatation`)."""
    viscous: bool
    forced: bool
    """Body forces act on particles."""
    boundary: str
    """`rigid`, `sliding`, `soft` or `free`: see `fracsim.mpm.boundary`."""
    real: Any
    """Floating-point type."""

    @property
    def holds_nodes(self) -> bool:
        """Whether the boundary prescribes velocities of nodes."""
        return self.boundary in ("rigid", "sliding")


class ParticleArrays(NamedTuple):
    """The arrays of N particles; `theta` and `cell_counts` have length 1 unless the pressure is that of cells."""

    X: Any
    """Rest positions relative to the object's centre [m], (N,) vec3."""
    U: Any
    """Displacements [m], (N,) vec3."""
    V: Any
    """Velocities [m/s], (N,) vec3; valid between calls, not between substeps."""
    C: Any
    """Affine velocities [1/s], (N,) mat3; valid as V."""
    grad_u: Any
    """Displacement gradients F - I, (N,) mat3: beside 1, float32 would lose what a short substep adds."""
    D: Any
    """Damage, (N,)."""
    volume: Any
    """Volumes at rest [m^3], (N,)."""
    tag: Any
    """Grip, and exemption from damage (`fracsim.mpm.params`), (N,) int."""
    anchor: Any
    """Displacements when the grid was laid out [m], (N,) vec3."""
    force: Any
    """Body forces a mass [m/s^2], (N,) vec3; of length 1 without body forces."""
    cell_counts: Any
    """Particles per cell at rest, stored at the cell's first particle, 0 elsewhere, (N,) int."""
    theta: Any
    """Mean volume ratio of the particle's cell, (N,)."""
    scratch: Any
    """Velocities of a cell's particles until the cell's mean is known, (threads, a power of 2) vec4."""


class NodeArrays(NamedTuple):
    """The M nodes near a particle, and how the boundary holds them (`fracsim.mpm.boundary.Holding`)."""

    index: Any
    """Their indices in the box, (M,) int."""
    grip: Any
    """The grip that each moves with, (M,) int; of the rest configuration."""
    edge: Any
    """The edge and the second node behind it, for the first node behind an edge, else -1, (M, 2) int."""
    edge_weights: Any
    """Weights of this node and of the second one in the edge's velocity, (M, 2)."""
    source: Any
    """Where each lies in each thread's copy, or -1, (M, threads) int."""


class Context(NamedTuple):
    """All of it, for one thread."""

    variant: Variant
    params: Any
    """Numbers, (PARAMETERS,)."""
    particles: ParticleArrays
    nodes: NodeArrays
    grid: Grid
    tally: Tally


class Motion(NamedTuple):
    """How a particle moves."""

    v: Any
    """Velocity [m/s]."""
    C: Any
    """Affine velocity [1/s]."""


class Strain(NamedTuple):
    """How a particle is deformed."""

    F: Any
    cof: Any
    """cof F = J F^-T."""
    J: Any
    """det F."""
