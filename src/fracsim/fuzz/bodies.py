"""Objects as particles: bars and blocks, and the awkward ones that no mesh would give."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fracsim.lab.stage import particles
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Solver


@dataclass(kw_only=True)
class Body:
    """An object of the study as plain data."""

    kind: str = "bar"
    """A function of `KINDS`."""
    counts: list[int] = field(default_factory=lambda: [20, 6, 6])
    """Particles along x, y and z, of all parts together."""
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """How far the object is moved off the symmetric place on the grid [cells]."""
    seed: int = 0


def build(body: Body, solver: Solver) -> Particles:
    """The particles of a body at the spacing of a solver."""
    X = np.asarray(CENTRE) + points(body) * solver.spacing + np.asarray(body.shift) * solver.h
    return particles(X, solver.spacing)


def points(body: Body) -> Array:
    """Positions about the origin in units of the spacing, (N, 3) float64."""
    return KINDS[body.kind](np.array(body.counts), np.random.default_rng(body.seed))


def _box(counts: Array) -> Array:
    """Lattice points about the origin in units of the spacing, (N, 3)."""
    axes = [np.arange(n) - (n - 1) / 2 for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def _bar(counts: Array, rng: np.random.Generator) -> Array:
    return _box(counts)


def _halves(counts: Array, gap: float, across: float = 0.0) -> Array:
    """Two blocks with a gap along x, the second one moved across by a part of the spacing."""
    block = _box(np.array([max(1, counts[0] // 2), counts[1], counts[2]]))
    away = np.array([(max(1, counts[0] // 2) - 1 + gap) / 2, across / 2, 0.0])
    return np.concatenate([block - away, block + away])


def _touching(counts: Array, rng: np.random.Generator) -> Array:
    """Two blocks whose lattices do not match."""
    return _halves(counts, 1.0, across=0.5)


def _disjoint(counts: Array, rng: np.random.Generator) -> Array:
    """Two blocks further apart than the grid reaches."""
    return _halves(counts, 12.0)


def _bridged(counts: Array, rng: np.random.Generator) -> Array:
    """Two blocks and one particle between them."""
    return np.concatenate([_halves(counts, 2.0), np.zeros((1, 3))])


def _cloud(counts: Array, rng: np.random.Generator) -> Array:
    """As many random points as the lattice would have."""
    out: Array = (rng.random((int(np.prod(counts)), 3)) - 0.5) * counts
    return out


def _hollow(counts: Array, rng: np.random.Generator) -> Array:
    """The outermost layer of a box."""
    points = _box(counts)
    shell = (np.abs(points) > (counts - 1) / 2 - 0.25).any(axis=1)
    return points[shell]


KINDS: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "bar": _bar,
    "touching": _touching,
    "disjoint": _disjoint,
    "bridged": _bridged,
    "cloud": _cloud,
    "hollow": _hollow,
}
"""Plates, wires and specks are bars of few particles."""
