"""The generalised vortex (Kamojjala et al. 2015): an annulus whose rings turn against each other, by a body force.

Plane strain and volume-preserving: x = Q(alpha(R, t)) X with alpha = A sin(pi t) (1 - 32 (R - 1)^2 + 256 (R - 1)^4).
"""

from collections.abc import Iterator

import numpy as np

from fracsim.lab.stage import advance, flat, free, medium, ordered, particles, put
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Material
from fracsim.verify.problem import Check, Setting, at_least, told

E, NU, DENSITY, TURN, DURATION = 1e3, 0.3, 1e3, 0.5, 0.5
"""Modulus [Pa], Poisson's ratio, density [kg/m^3], amplitude A [rad], time of the largest turn [s].

A is half the original: at A = 1, a shear of 6, neo-Hookean particles were crushed on 16 and 32 cells a metre."""
MU = E / (2 * (1 + NU))
INNER, OUTER, BUFFER = 0.75, 1.25, 3
"""Radii [m]; cells of material at rest beyond them."""
LAWS = ("fixed_corotated", "neo_hookean")


def turn(R: Array, t: float) -> tuple[Array, Array, Array]:
    """alpha / sin(pi t) and its first two derivatives by R; nothing outside of the annulus."""
    s, inside = R - 1, (R > INNER) & (R < OUTER)
    parts = 1 - 32 * s**2 + 256 * s**4, -64 * s + 1024 * s**3, -64 + 3072 * s**2
    first, second, third = (TURN * np.where(inside, part, 0.0) for part in parts)
    return first, second, third


def stress_divergence(law: str, R: Array, slope: Array, bend: Array) -> tuple[Array, Array]:
    """Radial and tangential div sigma [Pa/m] for alpha_R = slope and alpha_RR = bend; g = R alpha_R is the shear."""
    g, dg = R * slope, slope + R * bend
    if law == "neo_hookean":
        return -MU * g**2 / R, MU * (dg + 2 * g / R)
    s = np.sqrt(4 + g**2)
    rr, rt, tt = 1 - 2 / s, g * (1 - 1 / s), 1 + g**2 - (2 + g**2) / s
    radial = 2 * g / s**3 * dg + (rr - tt) / R
    tangential = (1 - 1 / s + g**2 / s**3) * dg + 2 * rt / R
    return 2 * MU * radial, 2 * MU * tangential


def frame(X: Array, angle: Array) -> tuple[Array, Array]:
    """Unit vectors e_r and e_theta of particles at X, (N, 3) [m], turned by an angle."""
    theta = np.arctan2(X[:, 1], X[:, 0]) + angle
    zero = np.zeros_like(theta)
    return (np.stack([np.cos(theta), np.sin(theta), zero], axis=1),
            np.stack([-np.sin(theta), np.cos(theta), zero], axis=1))  # fmt: skip


def displacement(X: Array, t: float) -> Array:
    """u [m], (N, 3)."""
    R = np.hypot(X[:, 0], X[:, 1])
    e_r, _ = frame(X, turn(R, t)[0] * np.sin(np.pi * t))
    return np.asarray(R[:, None] * e_r - X * [1, 1, 0])


def acceleration(X: Array, t: float) -> Array:
    """d2u/dt2 [m/s^2], (N, 3)."""
    R = np.hypot(X[:, 0], X[:, 1])
    a = turn(R, t)[0]
    e_r, e_t = frame(X, a * np.sin(np.pi * t))
    radial, tangential = -R * (a * np.pi * np.cos(np.pi * t)) ** 2, -R * a * np.pi**2 * np.sin(np.pi * t)
    return np.asarray(radial[:, None] * e_r + tangential[:, None] * e_t)


def body_force(law: str, X: Array, t: float) -> Array:
    """b = d2u/dt2 - div sigma / rho [m/s^2], (N, 3)."""
    R, swing = np.hypot(X[:, 0], X[:, 1]), np.sin(np.pi * t)
    a, slope, bend = turn(R, t)
    radial, tangential = stress_divergence(law, R, swing * slope, swing * bend)
    e_r, e_t = frame(X, a * swing)
    return np.asarray(acceleration(X, t) - (radial[:, None] * e_r + tangential[:, None] * e_t) / DENSITY)


def annulus(setting: Setting, law: str, cells: int) -> State:
    """One layer of particles with the first velocities; `cells` a metre."""
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
    e_r, e_t = frame(X, 0 * R)
    spin = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    C = np.pi * (a[:, None, None] * spin + (R * slope)[:, None, None] * e_t[:, :, None] * e_r[:, None, :])
    put(state, V=np.pi * (a * R)[:, None] * e_t, C=C)
    return state


def error(setting: Setting, law: str, cells: int) -> float:
    """Root mean square error of the displacement at DURATION over that of the displacement."""
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
        if t == 0:  # velocities lie half a substep behind displacements
            put(state, V=state.points.V.to_numpy() - dt / 2 * acceleration(X, 0.0))
        flatten(t, dt)
        if state.total:
            nodes = state.grid.velocity.to_numpy()
            nodes[still] = 0
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
    """Cells 8 to 64 a metre, for both laws."""
    sizes = (8, 16) if setting.quick else (8, 16, 32, 64)
    for law in LAWS:
        errors = []
        for cells in sizes:
            errors.append(error(setting, law, cells))
            yield Check(f"{law}, rms error of u, {cells} cells", 0, errors[-1], errors[-1], axis="h", at=1 / cells)
        name, found = f"{law}, order between {sizes[0]} and {sizes[-1]} cells", np.log(errors[0] / errors[-1])
        order = float(found / np.log(sizes[-1] / sizes[0]))
        yield told(name, order) if setting.quick else at_least(name, 1.5, order)
