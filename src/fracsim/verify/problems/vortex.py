"""The generalised vortex (Kamojjala et al. 2015): an annulus whose rings rotate against each other, by a body force.

Plane strain and volume-preserving: x = Q(alpha(R, t)) X with alpha = A sin(pi t) (1 - 32 (R - 1)^2 + 256 (R - 1)^4).
Functions of X take rest positions [m from the centre], (N, 3); R = |X|, (N,); t in s.
"""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, flat, free, medium, ordered, particles, put
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Material
from fracsim.verify.problem import Check, Setting, at_least, reported

E, NU, DENSITY, TURN, DURATION = 1e3, 0.3, 1e3, 0.5, 0.5
"""Modulus [Pa], Poisson's ratio, density [kg/m^3], amplitude A [rad], time of the largest rotation [s].

A is half the original: at A = 1, a shear of 6, neo-Hookean particles were crushed on 16 and 32 cells a metre."""
MU = E / (2 * (1 + NU))
INNER, OUTER, BUFFER = 0.75, 1.25, 3
"""Radii [m]; width of the material at rest beyond them [cells]."""
ORDER = 1.5
"""Second order, but for first order in the cells at the two rims, where the curvature of alpha jumps: h sqrt(h) in the
root mean square. The annulus is 4 cells wide on 8 cells a metre, too few to show an order."""
LAWS = ("fixed_corotated", "neo_hookean")


def turn(R: Array, t: float) -> tuple[Array, Array, Array]:
    """alpha / sin(pi t) and its first two derivatives by R, (N,) each, at R (N,); zero outside the annulus."""
    s, inside = R - 1, (R > INNER) & (R < OUTER)
    parts = 1 - 32 * s**2 + 256 * s**4, -64 * s + 1024 * s**3, -64 + 3072 * s**2
    first, second, third = (TURN * np.where(inside, part, 0.0) for part in parts)
    return first, second, third


def stress_divergence(law: str, R: Array, slope: Array, curvature: Array) -> tuple[Array, Array]:
    """Radial and tangential div sigma [Pa/m], (N,) each, at R (N,).

    slope (N,) is alpha_R, curvature (N,) is alpha_RR; the shear is g = R alpha_R.
    """
    g, dg = R * slope, slope + R * curvature
    if law == "neo_hookean":
        return -MU * g**2 / R, MU * (dg + 2 * g / R)
    s = np.sqrt(4 + g**2)
    rr, rt, tt = 1 - 2 / s, g * (1 - 1 / s), 1 + g**2 - (2 + g**2) / s
    radial = 2 * g / s**3 * dg + (rr - tt) / R
    tangential = (1 - 1 / s + g**2 / s**3) * dg + 2 * rt / R
    return 2 * MU * radial, 2 * MU * tangential


def polar_basis(X: Array, angle: Array) -> tuple[Array, Array]:
    """Unit vectors e_r and e_theta, (N, 3) each, of particles at X (N, 3), rotated by angles (N,)."""
    theta = np.arctan2(X[:, 1], X[:, 0]) + angle
    zero = np.zeros_like(theta)
    return (np.stack([np.cos(theta), np.sin(theta), zero], axis=1),
            np.stack([-np.sin(theta), np.cos(theta), zero], axis=1))  # fmt: skip


def displacement(X: Array, t: float) -> Array:
    """u [m], (N, 3), at X (N, 3)."""
    R = np.hypot(X[:, 0], X[:, 1])
    e_r, _ = polar_basis(X, turn(R, t)[0] * np.sin(np.pi * t))
    return np.asarray(R[:, None] * e_r - X * [1, 1, 0])


def acceleration(X: Array, t: float) -> Array:
    """d2u/dt2 [m/s^2], (N, 3), at X (N, 3)."""
    R = np.hypot(X[:, 0], X[:, 1])
    a = turn(R, t)[0]
    e_r, e_t = polar_basis(X, a * np.sin(np.pi * t))
    radial, tangential = -R * (a * np.pi * np.cos(np.pi * t)) ** 2, -R * a * np.pi**2 * np.sin(np.pi * t)
    return np.asarray(radial[:, None] * e_r + tangential[:, None] * e_t)


def body_force(law: str, X: Array, t: float) -> Array:
    """b = d2u/dt2 - div sigma / rho [m/s^2], (N, 3), at X (N, 3)."""
    R, swing = np.hypot(X[:, 0], X[:, 1]), np.sin(np.pi * t)
    a, slope, curvature = turn(R, t)
    radial, tangential = stress_divergence(law, R, swing * slope, swing * curvature)
    e_r, e_t = polar_basis(X, a * swing)
    return np.asarray(acceleration(X, t) - (radial[:, None] * e_r + tangential[:, None] * e_t) / DENSITY)


def annulus(setting: Setting, law: str, cells: int) -> State:
    """One layer of particles with their initial velocities, `cells` cells a metre."""
    solver = setting.solver(2 * cells)
    n = int((OUTER + BUFFER * solver.h) / solver.spacing) + 1
    axis = (np.arange(-n, n) + 0.5) * solver.spacing
    X = np.stack([*np.meshgrid(axis, axis, indexing="ij"), np.zeros((2 * n, 2 * n))], axis=-1).reshape(-1, 3)
    R = np.hypot(X[:, 0], X[:, 1])
    X = ordered(X[(R > INNER - BUFFER * solver.h) & (R < OUTER + BUFFER * solver.h)] + CENTRE, solver.h)
    body = particles(X, solver.spacing)
    state = free(medium(solver, Material(law=law, E=E, nu=NU, density=DENSITY)), body)
    X = state.X0.astype(float)
    R = np.hypot(X[:, 0], X[:, 1])
    a, slope, _ = turn(R, 0.0)
    e_r, e_t = polar_basis(X, 0 * R)
    spin = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    C = np.pi * (a[:, None, None] * spin + (R * slope)[:, None, None] * e_t[:, :, None] * e_r[:, None, :])
    put(state, V=np.pi * (a * R)[:, None] * e_t, C=C)
    return state


def error(setting: Setting, law: str, cells: int) -> float:
    """Root mean square error of the displacement at DURATION over its root mean square."""
    state = annulus(setting, law, cells)
    X = state.X0.astype(float)
    R = np.hypot(X[:, 0], X[:, 1])
    outside, flatten = (R <= INNER) | (R >= OUTER), flat(state, (2,))
    box = state.grid.layout
    place = np.stack(np.unravel_index(np.arange(box.size), box.shape), axis=1) + box.lowest
    far = np.hypot(*(place * state.medium.h)[:, :2].T)
    still = (far <= INNER) | (far >= OUTER)

    def before(t: float, dt: float) -> None:
        put(state, force=body_force(law, X, t))
        if t == 0:  # velocities are half a substep behind displacements
            put(state, V=state.points.V.to_numpy() - dt / 2 * acceleration(X, 0.0))
        flatten(t, dt)
        if state.total:
            nodes = state.grid.velocity.to_numpy()
            nodes[: box.size][still] = 0
            state.grid.velocity.from_numpy(nodes)
        for name in ("U", "V", "C", "F"):
            values = getattr(state.points, name).to_numpy()
            values[outside] = np.eye(3) if name == "F" else 0
            put(state, **{name: values})

    advance(state, DURATION, before=before)
    exact = displacement(X, DURATION)[~outside]
    wrong = (state.points.U.to_numpy().astype(float)[~outside] - exact)[:, :2]
    return float(np.sqrt((wrong**2).sum() / (exact**2).sum()))


def run(setting: Setting) -> Iterator[Check]:
    """8 to 64 cells a metre, for both laws."""
    sizes = (8, 16) if setting.quick else (8, 16, 32, 64)
    for law in LAWS:
        errors = []
        for cells in sizes:
            errors.append(error(setting, law, cells))
            yield Check(f"{law}, rms error of u, {cells} cells", 0, errors[-1], errors[-1], axis="h", at=1 / cells)
        order = float(np.log2(errors[-2] / errors[-1]))
        name = f"{law}, order between {sizes[-2]} and {sizes[-1]} cells"
        yield reported(name, order) if setting.quick else at_least(name, ORDER, order)
