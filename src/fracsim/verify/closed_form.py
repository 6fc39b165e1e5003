"""The constitutive laws and the damage law in NumPy, by principal stretches; stresses over E, Young's modulus."""

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fracsim.records import Array


def lame(nu: float) -> tuple[float, float]:
    """mu / E and lam / E."""
    return 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))


def nominal(law: str, nu: float, stretches: Array) -> Array:
    """Principal first Piola-Kirchhoff stresses / E, (..., 3), at principal stretches (..., 3)."""
    mu, lam = lame(nu)
    l = np.asarray(stretches, float)
    J = l.prod(axis=-1, keepdims=True)
    if law == "fixed_corotated":
        tau = 2 * mu * (l - 1) * l + lam * J * (J - 1)
    elif law == "neo_hookean":
        tau = mu * (l**2 - 1) + lam * np.log(J)
    else:
        tau = mu * J ** (-2 / 3) * (l**2 - (l**2).sum(axis=-1, keepdims=True) / 3) + lam / 2 * (J**2 - 1)
    return np.asarray(tau / l)


def lateral_stretch(law: str, nu: float, stretch: float) -> float:
    """Lateral stretch of a bar with free sides, the root of P22 = 0."""
    return float(brentq(lambda s: nominal(law, nu, np.array([stretch, s, s]))[1], 0.2, 1.5, xtol=1e-14))


def uniaxial(law: str, nu: float, stretch: float) -> tuple[float, float, float]:
    """Nominal stress / E, Cauchy stress / E (also the von Mises stress), and J of a bar with free sides."""
    s = lateral_stretch(law, nu, stretch)
    P = float(nominal(law, nu, np.array([stretch, s, s]))[0])
    return P, P / s**2, stretch * s**2


def damage(stretch: float, onset: float, crit: float) -> float:
    """Damage by Eq. 4 of the paper under growing stretch."""
    return min(max((stretch - onset) / (crit - onset), 0.0), 1.0)


def softening(law: str, nu: float, onset: float, crit: float) -> tuple[float, float, float]:
    """Failure of a uniform bar, at the peak of (1 - d) P: stretch, (1 - d) P / E, and work to complete failure per
    volume / E.
    """

    def load(stretch: float) -> float:
        """(1 - d) P / E."""
        return (1 - damage(stretch, onset, crit)) * uniaxial(law, nu, stretch)[0]

    best = minimize_scalar(lambda s: -load(s), bounds=(onset, crit), method="bounded", options={"xatol": 1e-10})
    peak = max((float(best.x), onset), key=load)
    grid = np.unique(np.concatenate([np.linspace(1, onset, 400), np.linspace(onset, crit, 400)]))
    return peak, load(peak), float(np.trapezoid([load(s) for s in grid], grid))
