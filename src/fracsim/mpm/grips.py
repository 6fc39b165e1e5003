"""Two grips that move apart: which particles and nodes they hold."""

from dataclasses import dataclass

import numpy as np

from fracsim.mpm.boundary import IN_EDGE, Holding
from fracsim.mpm.ends import BESIDE, End, end
from fracsim.mpm.layout import Layout
from fracsim.mpm.params import HALF, REACH, SPEED, UX, UZ
from fracsim.records import Array

NEIGHBOUR = 1.5
"""Particles at most this many spacings apart at rest belong to one body."""


@dataclass(frozen=True)
class Grips:
    """Slabs across the axis at rest, `thickness` thick, whose middle planes are `offset` from the object's centre."""

    mode: str
    """`rigid`, `sliding` or `soft`."""
    axis: tuple[float, float, float]
    """Unit vector of the tearing axis."""
    offset: float
    """[m]"""
    thickness: float
    """[m]"""
    speed: float
    """Of each grip, outwards [m/s]."""
    h: float
    """Cell size [m]."""
    damage_near: bool = False
    """Whether what is held or near a grip gathers damage."""

    def along(self, x: Array) -> Array:
        """Distance of points x [m], (N, 3), from the object's centre along the axis [m], (N,) float64."""
        return np.asarray(x @ np.asarray(self.axis))

    @property
    def end(self) -> End:
        """How the body ends at a face."""
        return end(max(np.abs(self.axis)))

    def side(self, x: Array) -> Array:
        """The grip, -1 or +1, that holds each particle at rest at x [m], (N, 3), else 0, (N,) int32.

        Raises ValueError naming the grip that holds no particle.
        """
        s = self.along(x)
        side = (np.abs(s - self.offset) <= self.thickness / 2).astype(np.int32)
        side -= np.abs(s + self.offset) <= self.thickness / 2
        for sign, name in ((-1, "lower"), (1, "upper")):
            if not (side == sign).any():
                reach = f"the object spans {s.min():.3g}..{s.max():.3g} m along the tearing axis"
                raise ValueError(
                    f"loading.offset={self.offset:g}: the {name} grip holds no particle ({reach}). "
                    "Choose a smaller loading.offset, a larger loading.thickness or another axis." + self._way_out(x)
                )
        return side

    def _way_out(self, x: Array) -> str:
        """Fields for which both grips hold some of the particles at x [m], (N, 3), as a sentence; empty if none do."""
        held, ways = max(1, len(x) // 200), []
        for degrees in (0, 90, *(a for a in range(0, 180, 15) if a % 90)):
            s = x @ np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
            if _least(s, self.offset, self.thickness) >= held:
                ways = [f"loading.axis_deg={degrees}"]
                break
        s = self.along(x)
        reach = float(min(-s.min(), s.max()))
        for share in (0.8, 0.65, 0.5):
            offset = float(f"{share * reach:.2g}")
            for thickness in (self.thickness, float(f"{0.4 * offset:.2g}")):
                if 2 * offset > 1.5 * thickness and _least(s, offset, thickness) >= held:
                    thin = f" loading.thickness={thickness:g}" if thickness != self.thickness else ""
                    return f" Both hold some with {' or with '.join([f'loading.offset={offset:g}{thin}', *ways])}."
        return f" Both hold some with {ways[0]}." if ways else ""

    def exempt(self, x: Array) -> Array:
        """Which particles at rest at x [m], (N, 3), gather no damage: those that a grip holds, (N,) bool."""
        return np.asarray((self.side(x) != 0) & (not self.damage_near))

    def excess(self, x: Array, spacing: float) -> Array:
        """By how much particles at rest at x [m], (N, 3), strain more where the load enters, relative, (N,).

        Only bodies that a grip holds do, as far as they are joined to what it holds beside the face; `spacing` [m] is
        that of neighbours in a body.
        """
        out = np.zeros(len(x))
        if self.damage_near:
            return out
        s, side = self.along(x), self.side(x)
        outside = np.abs(s) - self.offset
        for out_of, face in ((-1, self.offset - self.thickness / 2), (1, self.offset + self.thickness / 2)):
            here = (side == 0) & (out_of * outside > 0)
            distance = (np.abs(outside[here]) - self.thickness / 2) / self.h
            out[here] = self.end.excess(distance, -out_of * face / self.h)
        near = np.flatnonzero(np.abs(outside) < self.thickness / 2 + BESIDE[-1] * self.h)
        out[near[~_joined(x[near], side[near] != 0, NEIGHBOUR * spacing)]] = 0
        return out

    def fill(self, params: Array) -> None:
        """Set the slots of the grips in `params`, (PARAMETERS,).

        Without edges (`updated`), nodes up to HALF from a middle plane move: right on average.
        """
        params[SPEED], params[UX : UZ + 1] = self.speed, self.axis
        params[REACH], params[HALF] = self.offset, self.thickness / 2 + (self.end.soft + self.end.pitch / 2) * self.h

    def holding(self, layout: Layout, x: Array) -> Holding:
        """How the grips hold the nodes of a layout, which lie at x [m from the object's centre] at rest, (M, 3)."""
        axis, hung = np.asarray(self.axis), self.end
        k, s = int(np.abs(axis).argmax()), x @ axis
        side, outside = np.sign(s), np.abs(s) - self.offset
        gap = (np.abs(outside) - self.thickness / 2) / self.h - hung.soft
        edge = np.flatnonzero((gap > 0) & (gap <= hung.pitch))
        direction = (side * np.sign(outside) * np.sign(axis[k]))[edge]
        first = layout.neighbour(edge, k, direction)
        second = np.where(first < 0, -1, layout.neighbour(first, k, direction))
        once = np.bincount(np.concatenate([first, second]) + 1) == 1
        fits = (second >= 0) & (gap[first] > hung.pitch) & (gap[second] > hung.pitch)
        fits &= once[first + 1] & once[second + 1]
        grip = side * (gap <= 0)
        grip[edge] = side[edge] * np.where(fits, IN_EDGE, gap[edge] <= hung.pitch / 2)
        edge, first, second = edge[fits], first[fits], second[fits]
        out = Holding.by(grip)
        out.grip[second] = IN_EDGE * side[edge]  # the sign of a second node is not read
        out.edge[first] = np.stack([edge, second], axis=1)
        out.weights[first] = hung.weights(gap[edge])
        return out


def _joined(x: Array, held: Array, reach: float) -> Array:
    """Which points x (N, 3), each joined to those within `reach`, are joined to one that is `held`, (N,) bool."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(reach, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs), np.int8), tuple(pairs.T)), shape=(len(x), len(x)))
    part = connected_components(graph, directed=False)[1]
    return np.isin(part, part[held])


def _least(s: Array, offset: float, thickness: float) -> int:
    """The smaller number of particles at distances s (N,) that grips at -offset and +offset hold."""
    return int(min((np.abs(s - offset) <= thickness / 2).sum(), (np.abs(s + offset) <= thickness / 2).sum()))
