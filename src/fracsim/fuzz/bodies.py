"""Objects as particles: bars and blocks, and shapes that no mesh would give.

The functions of `KINDS` take the numbers of particles along x, y and z, (3,), and a generator. They return positions
about the origin in units of the spacing, (N, 3).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fracsim.lab.stage import particles
from fracsim.records import Array, Particles
from fracsim.scene.vocab import CENTRE, Solver


@dataclass(kw_only=True)
class Body:
    """Plain data of an object of the study."""

    kind: str = "bar"
    """A key of `KINDS`."""
    counts: list[int] = field(default_factory=lambda: [20, 6, 6])
    """Particles along x, y and z, of all parts together."""
    shift: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    """Shift of the object from its symmetric place on the grid [cells]."""
    seed: int = 0


def build(body: Body, solver: Solver) -> Particles:
    """The particles of a body, solver.spacing apart."""
    X = np.asarray(CENTRE) + points(body) * solver.spacing + np.asarray(body.shift) * solver.h
    return particles(X, solver.spacing)


def points(body: Body) -> Array:
    """Positions of the particles about the origin in units of the spacing, (N, 3) float64."""
    return KINDS[body.kind](np.array(body.counts), np.random.default_rng(body.seed))


def _box(counts: Array) -> Array:
    """Lattice points about the origin in units of the spacing, (N, 3), `counts`, (3,), along x, y, z."""
    axes = [np.arange(n) - (n - 1) / 2 for n in counts]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def _bar(counts: Array, rng: np.random.Generator) -> Array:
    """All points of the lattice, (N, 3), with `counts`, (3,)."""
    return _box(counts)


def _halves(counts: Array, gap: float, across: float = 0.0) -> Array:
    """Two blocks, (N, 3), with a gap along x; the second is shifted along y by `across`. `counts`, (3,), is of both."""
    block = _box(np.array([max(1, counts[0] // 2), counts[1], counts[2]]))
    away = np.array([(max(1, counts[0] // 2) - 1 + gap) / 2, across / 2, 0.0])
    return np.concatenate([block - away, block + away])


def _touching(counts: Array, rng: np.random.Generator) -> Array:
    """Two adjacent blocks, (N, 3), with lattices that do not match; `counts`, (3,)."""
    return _halves(counts, 1.0, across=0.5)


def _disjoint(counts: Array, rng: np.random.Generator) -> Array:
    """Two blocks, (N, 3), too far apart to share a node, with `counts`, (3,)."""
    return _halves(counts, 12.0)


def _bridged(counts: Array, rng: np.random.Generator) -> Array:
    """Two blocks and one particle between them, (N, 3), with `counts`, (3,)."""
    return np.concatenate([_halves(counts, 2.0), np.zeros((1, 3))])


def _cloud(counts: Array, rng: np.random.Generator) -> Array:
    """As many random points, (N, 3), as the lattice of `counts`, (3,), has."""
    out: Array = (rng.random((int(np.prod(counts)), 3)) - 0.5) * counts
    return out


def _hollow(counts: Array, rng: np.random.Generator) -> Array:
    """The outermost layer, (N, 3), of the lattice of `counts`, (3,)."""
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
