"""Damage is the running maximum of Eq. 4 along a history of stretches."""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import bar, free, medium, put
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.problem import Check, Setting, absolute

HISTORY = (1, 1.5, 1.7, 2.1, 1.2, 2.1, 2.5, 2.2, 0.6)
THRESHOLDS = Fracture(onset=1.5, crit=2.3)
EXACT = (0, 0, 0.25, 0.75, 0.75, 0.75, 1, 1, 1)


def damage_after_each(state: State) -> Array:
    """Damage of all particles after each stretch of HISTORY, (stretches, N).

    Each stretch is set in F for a substep of 1e-9 s.
    """
    damage = []
    for stretch in HISTORY:
        put(state, F=np.diag([float(stretch), 1, 1]), V=np.zeros(3), C=np.zeros((3, 3)))
        state.run(1, 1e-9, 0.0)
        damage.append(state.points.D.to_numpy())
    return np.array(damage)


def run(setting: Setting) -> Iterator[Check]:
    """The history at thresholds 1.5 and 2.3."""
    solver = setting.solver(20)
    body = bar(solver, (0.6, 0.3, 0.3))
    state = free(medium(solver, Material(E=1e2, nu=0.3), THRESHOLDS), body)
    error = np.abs(damage_after_each(state) - np.array(EXACT)[:, None]).max()
    yield absolute("largest |d - running maximum|", 0, float(error), 1e-6)
