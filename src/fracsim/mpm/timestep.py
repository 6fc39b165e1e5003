"""How long a substep may be: the stability of one particle under elasticity, viscosity and its own motion."""

import math
from dataclasses import dataclass

from fracsim.mpm.medium import Medium
from fracsim.scene.vocab import DT0, H0

ROTATION = 0.2
"""A particle may turn or stretch by at most this much in a substep: dt |C| <= ROTATION."""
COURANT = 0.3
"""In `updated` a particle may cross at most this part of a cell in a substep."""
BODY = 0.8
"""Largest eigenvalue of a body, as a part of that of an isolated particle (`total`): particles share the mass of their
nodes. It is 0.66 to 0.79 for the built-in objects at rest (`python -m fracsim.bench spectrum`), and up to
1 for what is one particle thin. That is still stable at solver.safety=0.8: dt^2 k + 2 b dt <= 4 in `stable`.
"""
GROWTH = 1.05
"""A substep may be longer than the last one by at most this factor."""


@dataclass(frozen=True)
class Damping:
    """What damps the motion, as the kernels take it."""

    viscosity: float
    """2 eta [Pa s]: RPIC damping r is the viscosity r density h^2 / (4 dt)."""
    keep: float
    """Part of its velocity that a node keeps in a substep."""


def damping(medium: Medium, dt: float) -> Damping:
    """Damping in a substep of length dt [s]: invariant (`physical`), the paper's factors (`per_substep`), or none."""
    material, mode = medium.material, medium.solver.damping
    if mode == "none":
        return Damping(0.0, 1.0)
    if mode == "physical":
        return Damping(material.viscosity, math.exp(-material.decay * dt))
    r = material.viscosity * 4 * DT0 / (material.density * H0**2)
    return Damping(r * material.density * medium.solver.h**2 / (4 * dt), math.exp(-material.decay * DT0))


def stable(medium: Medium, stiffness: float, body: float = 1.0) -> float:
    """Largest stable substep of an isolated particle [s], or of a body whose largest eigenvalues are `body` times its.

    With C' = (1 - r) C - dt 4 / (density h^2) P(F), F' = F + dt C' and stiffness M = |dP/dF| it is the root of
    dt^2 k + 2 b dt = 4, where k = 4 M / (density h^2) and b dt = r: h sqrt(density / M) sqrt(1 - r / 2).
    """
    if stiffness == 0:  # nothing is left on the grid
        return math.inf
    inertia = medium.material.density * medium.solver.h**2
    k = 4 * body * stiffness / inertia
    if medium.solver.damping == "none":
        return 2 / math.sqrt(k)
    if medium.solver.damping == "per_substep":
        r = 4 * medium.material.viscosity * DT0 / (medium.material.density * H0**2)
        return math.sqrt(max(4 - 2 * r, 0.0) / k)
    b = 4 * body * medium.material.viscosity / inertia
    return (math.sqrt(b * b + 4 * k) - b) / k


def rest_stiffness(medium: Medium) -> float:
    """Largest eigenvalue of dP/dF of the undeformed material [Pa]."""
    return 3 * medium.material.lam + 2 * medium.material.mu


def stable_at_rest(medium: Medium) -> float:
    """Largest stable substep of the undeformed material [s]."""
    return stable(medium, rest_stiffness(medium))


def bearable(medium: Medium, dt: float, stiffness: float) -> float:
    """The largest viscosity 2 eta [Pa s] that a particle can bear in a substep dt beside `stiffness` [Pa] (`total`).

    It is where r / 2 + k dt^2 / 4 = 1 in `stable`. Compression by lambda makes a viscosity felt 1 / lambda^2 times as
    much; that of a crushed particle is held at this value, so that a few at a crack do not shorten the common substep.
    """
    inertia = medium.material.density * medium.solver.h**2 / BODY
    most = 2 * (1 - stiffness / inertia * dt**2) * inertia / (4 * dt)
    return max(most, damping(medium, dt).viscosity)


def projection(medium: Medium, dt: float) -> float:
    """Part of the nodes' velocity that a substep replaces by its projection on the particles (APIC), 0 to 1.

    The projection damps waves of a few cells: (k h)^4 / 40 of the amplitude each time. `solver.projection` counts how
    often it happens while a P wave crosses a cell, so that damping depends neither on dt nor, measured in cells, on h.
    """
    if "updated" == medium.solver.formulation or "every" == medium.solver.projection:
        return 1.0
    m = medium.material
    crossing = medium.solver.h * math.sqrt(m.density / (m.lam + 2 * m.mu))
    return min(1.0, float(medium.solver.projection) * dt / crossing)


def limit(medium: Medium, stiffness: float, fastest: float, rate: float) -> float:
    """The substep that `dt: auto` takes at the present state [s].

    In `updated` particles may come to lie by themselves at any time.
    """
    dt = medium.solver.safety * stable(medium, stiffness, BODY if medium.total else 1.0)
    if rate > 0:
        dt = min(dt, ROTATION / rate)
    if fastest > 0 and medium.solver.formulation == "updated":
        dt = min(dt, COURANT * medium.solver.h / fastest)
    return dt


def require_stable(medium: Medium) -> str:
    """A warning, or "", for a fixed dt.

    Raises ValueError when dt is beyond the bound and not overridden, and for a damping that no substep can bear.
    """
    dt, m = medium.solver.dt, medium.material
    bound = stable_at_rest(medium)
    if bound == 0:
        r = 4 * m.viscosity * DT0 / (m.density * H0**2)
        raise ValueError(
            f"material.viscosity={m.viscosity:g} Pa s is an RPIC damping of r = {r:.3g} a substep: "
            "solver.damping=per_substep is unstable from r = 2 on, whatever the substep. Use solver.damping=physical "
            f"or a viscosity below {m.viscosity * 2 / r:.3g} Pa s."
        )
    if isinstance(dt, str):
        return ""
    why = f"(E={m.E:g}, nu={m.nu:g}, density={m.density:g}, h={medium.solver.h:.4g} m)"
    if dt <= bound:
        return ""
    if not medium.solver.dt_override:
        raise ValueError(
            f"solver.dt={dt:g} s exceeds the stability bound {bound:.3g} s at rest {why}. "
            "Use solver.dt=auto, a smaller value, or solver.dt_override=true to try it all the same."
        )
    return f"solver.dt={dt:g} s exceeds the stability bound {bound:.3g} s at rest {why}"
