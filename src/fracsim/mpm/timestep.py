"""How long a substep may be: the stability of one particle under elasticity, viscosity and its own motion."""

import math
from dataclasses import dataclass

from fracsim.vocab import DT0, H0, Scene

ROTATION = 0.5
"""A particle may turn or stretch by at most this much in a substep: dt |C| <= ROTATION."""
COURANT = 0.3
"""In `updated` a particle may cross at most this part of a cell in a substep."""
MAX_RPIC = 1.2
"""In `total` compression 1 / lambda_min^2 makes the viscosity felt more; each particle's is held at what RPIC damping
of this r would be, so that a few crushed particles at a crack do not shorten everybody's substep. `limit` keeps r of
the undeformed material at 1 at most."""
GROWTH = 1.05
"""A substep may be longer than the last one by at most this factor."""


@dataclass(frozen=True)
class Damping:
    """What damps the motion, as the kernels take it."""

    viscosity: float
    """2 eta [Pa s]: RPIC damping r is the viscosity r density h^2 / (4 dt)."""
    keep: float
    """Part of its velocity that a node keeps in a substep."""


def damping(scene: Scene, dt: float) -> Damping:
    """Damping in a substep of length dt [s]: invariant (`physical`), the paper's factors (`per_substep`), or none."""
    material, mode = scene.material, scene.solver.damping
    if mode == "none":
        return Damping(0.0, 1.0)
    if mode == "physical":
        return Damping(material.viscosity, math.exp(-material.decay * dt))
    r = material.viscosity * 4 * DT0 / (material.density * H0**2)
    return Damping(r * material.density * scene.solver.h**2 / (4 * dt), math.exp(-material.decay * DT0))


def stable(scene: Scene, stiffness: float) -> float:
    """Largest stable substep of an isolated particle [s].

    With C' = (1 - r) C - dt 4 / (density h^2) P(F), F' = F + dt C' and stiffness M = |dP/dF| it is the root of
    dt^2 k + 2 b dt = 4, where k = 4 M / (density h^2) and b dt = r: h sqrt(density / M) sqrt(1 - r / 2).
    """
    inertia = scene.material.density * scene.solver.h**2
    k = 4 * stiffness / inertia
    if scene.solver.damping == "none":
        return 2 / math.sqrt(k)
    if scene.solver.damping == "per_substep":
        r = 4 * scene.material.viscosity * DT0 / (scene.material.density * H0**2)
        return math.sqrt(max(4 - 2 * r, 0.0) / k)
    b = 4 * scene.material.viscosity / inertia
    return (math.sqrt(b * b + 4 * k) - b) / k


def stable_at_rest(scene: Scene) -> float:
    """Largest stable substep of the undeformed material [s]."""
    return stable(scene, 3 * scene.material.lam + 2 * scene.material.mu)


def limit(scene: Scene, stiffness: float, fastest: float, rate: float) -> float:
    """The substep that `dt: auto` takes at the present state [s]."""
    dt = scene.solver.safety * stable(scene, stiffness)
    if scene.solver.damping == "physical" and scene.material.viscosity > 0:
        dt = min(dt, scene.material.density * scene.solver.h**2 / (4 * scene.material.viscosity))
    if rate > 0:
        dt = min(dt, ROTATION / rate)
    if fastest > 0 and scene.solver.formulation == "updated":
        dt = min(dt, COURANT * scene.solver.h / fastest)
    return dt


def require_stable(scene: Scene) -> str:
    """A warning, or "", for a fixed dt; raises ValueError when it is beyond the bound and not overridden."""
    dt = scene.solver.dt
    if isinstance(dt, str):
        return ""
    bound = stable_at_rest(scene)
    m = scene.material
    why = f"(E={m.E:g}, nu={m.nu:g}, density={m.density:g}, h={scene.solver.h:.4g} m)"
    if dt <= bound:
        return ""
    if not scene.solver.dt_override:
        raise ValueError(
            f"solver.dt={dt:g} s exceeds the stability bound {bound:.3g} s at rest {why}. "
            "Use solver.dt=auto, a smaller value, or solver.dt_override=true to try it all the same."
        )
    return f"solver.dt={dt:g} s exceeds the stability bound {bound:.3g} s at rest {why}"
