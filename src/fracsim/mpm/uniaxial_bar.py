"""A uniform bar with free sides: the stress and the damage at a given stretch."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.kernels import types
from fracsim.registry import load
from fracsim.tensor import cofactor, volume_ratio


@cache
def stretcher(law_name: str, damage_name: str, real: Any) -> Any:
    """The kernel that finds P [Pa] and d at given stretches, the sides at P22 = 0 by bisection.

    Arguments: mu, lam, onset, crit, stretches, and where P and d go.
    """
    law = load("fracsim.constitutive", law_name, "material.law")
    damage_law = load("fracsim.damage", damage_name, "fracture.law")
    Scalar = types(real)["scalar"]

    @ti.func
    def pulled(l, s, mu, lam):
        F = ti.Matrix([[l, l * 0, l * 0], [l * 0, s, l * 0], [l * 0, l * 0, s]])
        K = cofactor(F)
        J = volume_ratio(F, K)
        return F, law.piola(F, K, J, J, mu, lam)

    @ti.kernel
    def pull(mu: real, lam: real, onset: real, crit: real, stretch: Scalar, P: Scalar, d: Scalar):
        for q in range(stretch.shape[0]):
            l = stretch[q]
            narrow, wide = l * 0 + 0.05, l * 0 + 1.5
            for _ in range(50):
                s = (narrow + wide) / 2
                _F, stress = pulled(l, s, mu, lam)
                if stress[1, 1] > 0:
                    wide = s
                else:
                    narrow = s
            F, stress = pulled(l, narrow, mu, lam)
            P[q] = stress[0, 0]
            d[q] = damage_law.raw(F, l * narrow * narrow, onset, crit)

    return pull
