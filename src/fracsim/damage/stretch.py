"""Damage by the largest principal stretch (Eq. 4 of the paper)."""

import taichi as ti

from fracsim.tensor import max_stretch

LANES = True
"""It computes several particles side by side (`fracsim.lanes`)."""


@ti.func
def raw(F, J, onset, crit):
    d = (max_stretch(F, J, onset) - onset) / (crit - onset)
    return ti.min(ti.max(d, d * 0), d * 0 + 1)
