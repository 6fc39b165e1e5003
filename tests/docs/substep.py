"""docs/method.md in NumPy, step by step, in float64: what a reader of the page would write."""

import numpy as np

from fracsim.mpm.boundary import IN_EDGE
from fracsim.mpm.state import State
from fracsim.records import Array

OFFSETS = np.indices((3, 3, 3)).reshape(3, 27).T
I = np.eye(3)


def transposed(A: Array) -> Array:
    return np.swapaxes(A, 1, 2)


def squared(A: Array) -> Array:
    """|A|^2 of each matrix, (N, 1, 1)."""
    return (A**2).sum(axis=(1, 2), keepdims=True)


class Substep:
    """The particles and nodes of a state that is about to start; `advance` makes one substep."""

    def __init__(self, state: State, t: float) -> None:
        s, self.medium, self.total = state, state.medium, state.total
        self.h, self.density, self.X, self.side = s.medium.h, s.medium.material.density, s.X0, s.side
        self.volume, self.free, self.excess = s.points.volume.to_numpy(), ~s.exempt, s.excess
        self.u, self.v, self.C, self.F, self.d = (
            a.to_numpy() for a in (s.points.U, s.points.V, s.points.C, s.points.F, s.points.D)
        )
        self.boundary, self.nodes = s.boundary, s.grid.layout.positions()
        self.number = {tuple(node): i for i, node in enumerate(self.nodes)}
        self.holding = s.boundary.holding(s.grid.layout, self.nodes * self.h) if s.total else None
        self.cell = np.unique(np.floor(self.X / self.h - 0.5 + 1e-3), axis=0, return_inverse=True)[1].ravel()
        self.v_nodes, self.first, self.t = np.zeros((len(self.nodes), 3)), True, t

    def advance(self, dt: float) -> None:
        """Steps 5 to 9, then 2 to 4."""
        alpha = 1.0 if self.first or not self.total else self.alpha(dt)
        self.scatter(dt, alpha)
        self.t += dt
        self.move_nodes(dt, alpha)
        self.first = False
        self.gather(dt)
        self.grow_damage()

    def stencil(self) -> tuple[Array, Array, Array]:
        """Step 1: nodes (N, 27), weights (N, 27) and X_i - X_p (N, 27, 3); of x in `updated`."""
        x = self.X if self.total else self.X + self.u
        base = np.floor(x / self.h - 0.5).astype(int)
        f = x / self.h - base
        w = np.stack([(1.5 - f) ** 2 / 2, 0.75 - (f - 1) ** 2, (f - 0.5) ** 2 / 2], axis=1)
        at = base[:, None] + OFFSETS
        nodes = np.array([self.number[tuple(node)] for node in at.reshape(-1, 3)]).reshape(len(x), 27)
        return nodes, np.prod([w[:, OFFSETS[:, k], k] for k in range(3)], axis=0), self.h * at - x[:, None]

    def gather(self, dt: float) -> None:
        """Steps 2 and 3, of particles on the grid."""
        nodes, w, r = self.stencil()
        on = (self.d < 1) | (not self.total)
        v_i = self.v_nodes[nodes]
        v = np.einsum("pi,pik->pk", w, v_i)
        C = 4 / self.h**2 * np.einsum("pi,pij,pik->pjk", w, v_i, r)
        moved, held = v.copy(), self.side != 0
        if self.boundary.mode in ("rigid", "sliding"):
            moved[held] = self.prescribed(self.side[held], v[held])
        if not self.total:
            v = moved
        rate = C if self.total else C @ self.F
        turning = (C - transposed(C)) @ self.F / 2
        rate = np.where((self.d >= 1)[:, None, None] & (not self.total), turning, rate)
        self.u[on] += dt * moved[on]
        self.F[on] += dt * rate[on]
        self.v[on], self.C[on] = v[on], C[on]

    def grow_damage(self) -> None:
        """Step 4."""
        fracture = self.medium.fracture
        stretch = np.linalg.svd(self.F, compute_uv=False)[:, 0]
        onset, crit = (l + self.excess * (l - 1) for l in (fracture.onset, fracture.crit))
        raw = np.clip((stretch - onset) / (crit - onset), 0, 1)
        self.d = np.where(self.free, np.maximum(self.d, raw), self.d)

    def stress(self, dt: float) -> Array:
        """Steps 5 and 6: P, or tau in `updated`, (N, 3, 3)."""
        F, d, m = self.F, self.d[:, None, None], self.medium.material
        J = np.linalg.det(F)[:, None, None]
        cof = J * transposed(np.linalg.inv(F))
        theta = J
        if self.medium.solver.cellwise:
            weight = (1 - self.d) * self.volume
            whole, part = (np.bincount(self.cell, a) for a in (weight, weight * J.ravel()))
            theta = np.divide(part, whole, out=np.ones_like(whole), where=whole > 0)[self.cell][:, None, None]
        rate = (self.C * cof).sum(axis=(1, 2), keepdims=True)
        J, theta = np.maximum(J, 0.05), np.maximum(theta, 0.05)
        if m.law == "fixed_corotated":
            U, _, Vt = np.linalg.svd(F)
            P = 2 * m.mu * (F - U @ Vt) + m.lam * (theta - 1) * cof
        elif m.law == "neo_hookean":
            P = m.mu * F + (m.lam * np.log(theta) / theta - m.mu / J) * cof
        else:
            P = m.mu * J ** (-2 / 3) * (F - squared(F) / (3 * J) * cof) + m.lam / 2 * (theta - 1 / theta) * cof
        P = (1 - d) * P
        eta, inertia = m.viscosity / 2, self.density * self.h**2
        if not self.total:
            return P @ transposed(F) + eta * (self.C + transposed(self.C))
        q = 1.5 * inertia * rate**2 / (1 - 6 * dt * rate * squared(cof))
        P -= np.where((J < 0.8) & (rate < 0), q, 0) * cof
        M = 3 * m.lam + 2 * m.mu
        eta_max = max(2 * eta, inertia / (2 * 0.8 * dt) * (1 - 0.8 * M * dt**2 / inertia)) / 2
        N = squared(cof)
        S = (N + 2 * np.sqrt(np.maximum(N**2 - 3 * J**2 * squared(F), 0))) / 3
        s = np.minimum((1 - d) * eta / J**2, eta_max / S)
        return np.asarray(P + s * (self.C @ transposed(cof) + cof @ transposed(self.C)) @ cof)

    def scatter(self, dt: float, alpha: float) -> None:
        """Step 7, of particles on the grid."""
        nodes, w, r = self.stencil()
        on = (self.d < 1) | (not self.total)
        m = self.density * self.volume
        A = alpha * m[:, None, None] * self.C - 4 * dt / self.h**2 * self.volume[:, None, None] * self.stress(dt)
        given = w[..., None] * (alpha * m[:, None, None] * self.v[:, None] + np.einsum("pjk,pik->pij", A, r))
        self.mass, self.momentum = np.zeros(len(self.nodes)), np.zeros((len(self.nodes), 3))
        np.add.at(self.mass, nodes[on], (w * m[:, None])[on])
        np.add.at(self.momentum, nodes[on], given[on])

    def alpha(self, dt: float) -> float:
        m = self.medium.material
        speed = np.sqrt((m.lam + 2 * m.mu) / self.density)
        return float(min(1, self.medium.solver.projection * dt / self.h * speed))

    def move_nodes(self, dt: float, alpha: float) -> None:
        """Steps 8 and 9."""
        heavy = self.mass > 1e-12 * self.density * self.h**3
        v = np.zeros_like(self.v_nodes)
        v[heavy] = self.momentum[heavy] / self.mass[heavy, None] + (1 - alpha) * self.v_nodes[heavy]
        v[heavy] += dt * np.asarray(self.medium.gravity)
        driven = np.zeros_like(v)
        grip = self.grips_of_nodes()
        held = (np.abs(grip) == 1) & heavy
        v[held], driven[held] = self.prescribed(grip[held], v[held]), grip[held, None] * self.speed
        if self.holding is not None:
            for one in np.flatnonzero(self.holding.edge[:, 0] >= 0):
                self.tie(one, v, driven, heavy)
        self.v_nodes = driven + np.exp(-self.medium.material.decay * dt) * (v - driven)

    @property
    def speed(self) -> Array:
        """Velocity of the upper grip, (3,)."""
        return self.boundary.speed * np.asarray(self.boundary.axis)

    def prescribed(self, grip: Array, v: Array) -> Array:
        """Velocity that grips give to what moves with v, (n, 3)."""
        if self.boundary.mode == "rigid":
            return np.asarray(grip[:, None] * self.speed)
        a = np.asarray(self.boundary.axis)
        return np.asarray(v + (grip * self.boundary.speed - v @ a)[:, None] * a)

    def grips_of_nodes(self) -> Array:
        """The grip of each node, +-1; of the present position in `updated`."""
        if self.holding is not None:
            return self.holding.grip
        grips = self.boundary
        if grips.mode == "free":
            return np.zeros(len(self.nodes), int)
        s = self.nodes * self.h @ np.asarray(grips.axis)
        reach = grips.thickness / 2 + (grips.end.soft + grips.end.pitch / 2) * self.h
        return np.sign(s) * (np.abs(np.abs(s) - grips.offset - grips.speed * self.t) <= reach)

    def tie(self, one: int, v: Array, driven: Array, heavy: Array) -> None:
        """An edge and the two nodes next to it; v and `driven` change in place."""
        assert self.holding is not None
        (edge, two), b = self.holding.edge[one], self.holding.weights[one]
        if not heavy[[edge, one, two]].all():
            return
        grip = self.holding.grip[edge] // IN_EDGE * self.speed
        short = b[0] * (v[one] - grip) + b[1] * (v[two] - grip) - (v[edge] - grip)
        if self.boundary.mode == "sliding":
            a = np.asarray(self.boundary.axis)
            short = short @ a * a
        m = self.mass
        j = short / (1 / m[edge] + b[0] ** 2 / m[one] + b[1] ** 2 / m[two])
        v[edge] += j / m[edge]
        v[one] -= b[0] * j / m[one]
        v[two] -= b[1] * j / m[two]
        driven[edge] = (1 - b.sum()) * grip
