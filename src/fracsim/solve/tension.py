"""The load: the tension at the inner faces of the grips, without what moves the material that they hold."""

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Loading


class Tension:
    """The mean of both faces, averaged over the time since the call before.

    A grip also accelerates what it holds and what hangs beyond it. At the start of a pull that is a blow, and then the
    ends beyond the grips ring, for they are hardly damped: in a slender bar by several per cent of the load. So the
    balance of momentum of all that lies beyond a face is taken: its tension is the pull of the grip, and the weight of
    what lies there, less the change of its momentum.
    """

    def __init__(self, loading: Loading, X: Array, mass: Array) -> None:
        """Particles at rest at X [m], (N, 3), with their masses [kg], (N,)."""
        axis = np.asarray(loading.axis)
        s = (X.astype(np.float64) - CENTRE) @ axis
        self._beyond = np.flatnonzero(np.abs(s) >= loading.offset - loading.thickness / 2)
        self._half = np.sign(s[self._beyond, None]) * axis / 2  # outwards; half of it, for the mean of two faces
        self._weight = mass[self._beyond] * (self._half @ np.asarray(loading.gravity))
        self._momentum, self._impulse, self._t = np.zeros(len(self._beyond)), 0.0, 0.0

    def __call__(self, t: float, impulse: float, momentum: Array, failed: Array) -> float:
        """Load [N] at time t [s], after a first call at t = 0.

        `impulse` [N s] is that of both grips from the start, outwards, mean of the two; `momentum` [N s], (N, 3), that
        of the particles. Those that have `failed`, (N,) bool, are out of the balance.
        """
        kept, dt = ~failed[self._beyond], t - self._t
        outwards = (self._half * momentum[self._beyond]).sum(axis=1)
        gained = (outwards - self._momentum)[kept].sum()
        load = (impulse - self._impulse - gained) / dt + self._weight[kept].sum() if dt else 0.0
        self._momentum, self._impulse, self._t = outwards, impulse, t
        return float(load)
