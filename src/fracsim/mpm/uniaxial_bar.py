"""A uniform bar with free sides: the stress and the damage at a given stretch."""

from functools import cache
from typing import Any

import taichi as ti

from fracsim.mpm.kernels import types
from fracsim.registry import load
from fracsim.tensor import cofactor, volume_ratio


@cache
def stretcher(law_name: str, damage_name: str, real: Any) -> Any:
    """The kernel that finds nominal stress and damage at given stretches; bisection finds the sides, P22 = 0."""
    law = load("fracsim.constitutive", law_name, "material.law")
    damage_law = load("fracsim.damage", damage_name, "fracture.law")
    Scalar = types(real)["scalar"]

    @ti.func
    def pulled(l, s, mu, lam):
        F = ti.Matrix([[l, l * 0, l * 0], [l * 0, s, l * 0], [l * 0, l * 0, s]])
        cof = cofactor(F)
        J = volume_ratio(F, cof)
        return F, law.piola(F, cof, J, J, mu, lam)

    @ti.kernel
    def pull(
        mu: real, lam: real,  # Lame parameters [Pa]
        onset: real, crit: real,  # thresholds [1]
        stretch: Scalar,  # (M,)
        P: Scalar,  # out: nominal stress without damage [Pa], (M,)
        d: Scalar,  # out: damage, (M,)
    ):  # fmt: skip
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
