"""The constitutive laws and the damage law in NumPy, by principal stretches; in units of E where no E is given."""

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from fracsim.records import Array


def lame(nu: float) -> tuple[float, float]:
    """mu / E and lam / E."""
    return 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))


def nominal(law: str, nu: float, stretches: Array) -> Array:
    """Principal first Piola-Kirchhoff stresses / E at principal stretches, (..., 3)."""
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


def thinned(law: str, nu: float, stretch: float) -> float:
    """Lateral stretch of a bar with free sides, the root of P22 = 0."""
    return float(brentq(lambda s: nominal(law, nu, np.array([stretch, s, s]))[1], 0.2, 1.5, xtol=1e-14))


def uniaxial(law: str, nu: float, stretch: float) -> tuple[float, float, float]:
    """Nominal stress / E, Cauchy = von Mises stress / E, and J of a bar with free sides."""
    s = thinned(law, nu, stretch)
    P = float(nominal(law, nu, np.array([stretch, s, s]))[0])
    return P, P / s**2, stretch * s**2


def damage(stretch: float, onset: float, crit: float) -> float:
    """Eq. 4 of the paper under growing stretch."""
    return min(max((stretch - onset) / (crit - onset), 0.0), 1.0)


def softening(law: str, nu: float, onset: float, crit: float) -> tuple[float, float, float]:
    """A uniform bar fails where (1 - d) P peaks: stretch there, P / E there, and work to failure a volume / E."""

    def load(stretch: float) -> float:
        return (1 - damage(stretch, onset, crit)) * uniaxial(law, nu, stretch)[0]

    best = minimize_scalar(lambda s: -load(s), bounds=(onset, crit), method="bounded", options={"xatol": 1e-10})
    peak = max((float(best.x), onset), key=load)
    grid = np.unique(np.concatenate([np.linspace(1, onset, 400), np.linspace(onset, crit, 400)]))
    return peak, load(peak), float(np.trapezoid([load(s) for s in grid], grid))
