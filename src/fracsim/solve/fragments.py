"""The fragments of a body that tears: nodes of their own, crumbs, and whether the grips still hold one body."""

import numpy as np

from fracsim.mpm.energy import kinetic
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.solve.bonds import Bonds

RISKY = 1.2
"""Below this stretch the grid of `updated` does not tear anything."""


def joins(piece: Array, side: Array) -> bool:
    """Whether one piece, numbered from 0 in (N,), reaches from grip to grip; `side` is -1 and +1 there, (N,)."""
    low, high = piece[side < 0], piece[side > 0]
    return bool(np.isin(low[low >= 0], high[high >= 0]).any())


def judge(bonds: Bonds, side: Array, x: Array, F: Array, failed: Array) -> str:
    """`whole`, `broken` (by damage) or `torn` (numerically), by bonds that are intact and not longer than F says.

    x [m], (N, 3), and F, (N, 3, 3), are those of the frame; `side`, (N,), is the grip that holds a particle; `failed`,
    (N,) bool.
    """
    intact = bonds.intact(failed)
    torn = bonds.torn(intact, x, F)
    if not failed.any() and not torn.any():
        return "whole"
    if joins(bonds.pieces(intact[~torn]), side):
        return "whole"
    return "torn" if joins(bonds.pieces(intact), side) else "broken"


class Fragments:
    """Follows the fragments of a state; `crumb` is the size [particles] below which a fragment fails with the crack."""

    def __init__(self, state: State, bonds: Bonds, crumb: float) -> None:
        self.state, self.bonds, self.crumb = state, bonds, crumb
        self.of = np.zeros(state.n, np.int64)
        """The fragment of each particle, -1 for failed ones, (N,) (`total`)."""
        self.crumbled = 0.0
        """Energy that crumbs have taken along [J]."""

    def update(self) -> None:
        """Give each separated fragment its own nodes; fragments too small for the grid fail with the crack."""
        d = self.state.points.D.to_numpy()
        if int((d >= 1).sum()) == int((self.of < 0).sum()):
            return
        fragment = self.bonds.fragments(d >= 1)
        if (fragment < 0).all():
            self.of = fragment
            return
        size = np.bincount(fragment[fragment >= 0])
        crumbs = (fragment >= 0) & (size[fragment] < self.crumb) & (self.state.side == 0)
        if crumbs.any():
            self._fail(crumbs, d)
            fragment[crumbs] = -1
            fragment[fragment >= 0] = np.unique(fragment[fragment >= 0], return_inverse=True)[1]  # without gaps again
        intact = fragment >= 0
        if (fragment[intact] != self.of[intact]).any():
            self.state.split(fragment)
        self.of = fragment

    def _fail(self, crumbs: Array, d: Array) -> None:
        """Make the particles of crumbs, (N,) bool, fail; d, (N,), is the damage so far."""
        before = self._energy()
        d[crumbs] = 1
        self.state.points.D.from_numpy(d)
        self.crumbled += float(before - self._energy())

    def _energy(self) -> float:
        """Strain and kinetic energy [J]."""
        volume = self.state.points.volume.to_numpy().astype(np.float64)
        return float(volume @ self.state.observe().energy + kinetic(self.state))

    def verdict(self, x: Array, F: Array, failed: Array, stretch: float) -> str:
        """`whole`, `broken` (by damage) or `torn` (numerically: the grid has parted intact particles).

        x [m], (N, 3), F, (N, 3, 3), and `failed`, (N,) bool, are those of the frame, `stretch` the largest so far.
        """
        side = self.state.side
        if self.state.total:
            return "whole" if joins(self.of, side) else "broken"
        return "whole" if stretch < RISKY else judge(self.bonds, side, x, F, failed)
