"""Linear elasticity in plane strain by nine-node quadrilaterals: a reference for problems without a closed form."""

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import spsolve

from fracsim.records import Array
from fracsim.verify.closed_form import lame

GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)]), np.array([5, 8, 5]) / 9
"""Places and weights of Gauss's rule on [-1, 1]."""


def shapes(s: float) -> tuple[Array, Array]:
    """The three quadratic Lagrange polynomials on [-1, 1] at s, (3,), and their derivatives, (3,)."""
    return np.array([s * (s - 1) / 2, 1 - s * s, s * (s + 1) / 2]), np.array([s - 0.5, -2 * s, s + 0.5])


def mesh(corners: Array, n: int) -> tuple[Array, Array]:
    """Nodes ((2 n + 1)^2, 2) and elements (n^2, 9) of a quadrilateral with corners (4, 2).

    The corners are counter-clockwise from s = t = 0. Node i (2 n + 1) + j is at place (i, j) of the grid.
    """
    m = 2 * n + 1
    s, t = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, m), np.linspace(0, 1, m), indexing="ij"))
    weights = np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1)
    i, j = (a.ravel() for a in np.meshgrid(2 * np.arange(n), 2 * np.arange(n), indexing="ij"))
    local = np.array([[a, b] for a in range(3) for b in range(3)])
    return weights @ corners, (i[:, None] + local[:, 0]) * m + j[:, None] + local[:, 1]


def stiffness_matrix(nodes: Array, elements: Array, nu: float) -> coo_matrix:
    """The stiffness matrix / E of unit thickness, (2 V, 2 V), of nodes (V, 2) and elements (M, 9).

    The degree of freedom of a component is 2 node + component.
    """
    mu, lam = lame(nu)
    D = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    local = np.zeros((len(elements), 18, 18))
    for s, ws in zip(*GAUSS, strict=True):
        for t, wt in zip(*GAUSS, strict=True):
            (Ns, ds), (Nt, dt) = shapes(s), shapes(t)
            slope = np.stack([np.outer(ds, Nt).ravel(), np.outer(Ns, dt).ravel()])
            J = np.einsum("kn,enx->ekx", slope, nodes[elements])
            grad = np.linalg.solve(J, np.broadcast_to(slope, (len(J), 2, 9)))
            B = np.zeros((len(J), 3, 18))
            B[:, 0, 0::2], B[:, 1, 1::2] = grad[:, 0], grad[:, 1]
            B[:, 2, 0::2], B[:, 2, 1::2] = grad[:, 1], grad[:, 0]
            local += (ws * wt * np.linalg.det(J))[:, None, None] * (B.transpose(0, 2, 1) @ D @ B)
    dof = (2 * elements[:, :, None] + [0, 1]).reshape(len(elements), 18)
    rows, columns = np.repeat(dof, 18, axis=1).ravel(), np.tile(dof, (1, 18)).ravel()
    return coo_matrix((local.ravel(), (rows, columns)), shape=(2 * len(nodes),) * 2)


def edge_deflection(corners: Array, nu: float, n: int) -> float:
    """Mean of u_y [m] over the edge s = 1 of a quadrilateral with corners (4, 2) [m], divided into n^2 elements.

    The edge s = 1 has a unit shear traction / E, the edge s = 0 is held.
    """
    nodes, elements = mesh(corners, n)
    m, matrix = 2 * n + 1, stiffness_matrix(nodes, elements, nu).tocsr()
    edge = np.tile([2.0, 4.0], n + 1)[:m] / 6
    edge[[0, -1]] = 1 / 6  # Simpson's rule, in element lengths
    side = np.arange((m - 1) * m, m * m)
    force = np.zeros(2 * len(nodes))
    force[2 * side + 1] = edge / edge.sum() * np.linalg.norm(corners[2] - corners[1])
    free = np.arange(2 * m, 2 * len(nodes))
    u = np.zeros(2 * len(nodes))
    u[free] = spsolve(matrix[free][:, free].tocsc(), force[free])
    return float((edge / edge.sum()) @ u[2 * side + 1])
