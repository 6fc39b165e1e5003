"""Gaussian splatting in plain NumPy: every pixel, every Gaussian, no tiles; the standard for `fracsim.render`."""

from math import factorial

import numpy as np


def legendre(l, m, x):
    """Associated Legendre function with the Condon-Shortley phase, by the recurrence in l."""
    below, here = 0 * x, np.prod(np.arange(1.0, 2 * m, 2)) * (-np.sqrt(1 - x * x)) ** m
    for n in range(m, l):
        below, here = here, ((2 * n + 1) * x * here - (n + m) * below) / (n - m + 1)
    return here


def harmonics(directions, degree):
    """Real spherical harmonics, (N, (degree + 1)^2), in unit directions (N, 3), order m = -l..l."""
    x, y, z = directions.T
    phi = np.arctan2(y, x)
    columns = []
    for l in range(degree + 1):
        for m in range(-l, l + 1):
            n = abs(m)
            norm = np.sqrt((2 * l + 1) / (4 * np.pi) * factorial(l - n) / factorial(l + n) * (2 if m else 1))
            columns.append(norm * legendre(l, n, z) * (np.sin(n * phi) if m < 0 else np.cos(n * phi)))
    return np.stack(columns, axis=1)


def colour(sh, directions):
    """max(0, 0.5 + sum of coefficients times harmonics), (N, 3)."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    Y = harmonics(unit, round(sh.shape[1] ** 0.5) - 1)
    return np.maximum(0.5 + np.einsum("nk,nkc->nc", Y, sh), 0)


def symmetric(packed):
    """(N, 3, 3) from (N, 6) as xx, xy, xz, yy, yz, zz."""
    return packed[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


def project(view, means, covariance, F):
    """Depths (N,), image centres (N, 2) and image covariances (N, 2, 2) with the low pass, EWA with a held Jacobian."""
    W, shift = view.world_to_camera[:3, :3], view.world_to_camera[:3, 3]
    x, y, z = (means @ W.T + shift).T
    centre = np.stack([view.fx * x / z + view.cx, view.fy * y / z + view.cy], axis=1)
    # The Jacobian is taken no further out than 1.3 half pictures from the picture's middle.
    u = (np.clip(centre[:, 0], -0.15 * view.width, 1.15 * view.width) - view.cx) / view.fx
    v = (np.clip(centre[:, 1], -0.15 * view.height, 1.15 * view.height) - view.cy) / view.fy
    J = np.zeros((len(means), 2, 3))
    J[:, 0, 0], J[:, 0, 2] = view.fx / z, -view.fx * u / z
    J[:, 1, 1], J[:, 1, 2] = view.fy / z, -view.fy * v / z
    world = F @ symmetric(covariance) @ F.transpose(0, 2, 1)
    flat = J @ W @ world @ W.T @ J.transpose(0, 2, 1) + 0.3 * np.eye(2)
    return z, centre, flat


def render(view, means, covariance, F, opacity, features, tilt=(0, 0)):
    """Image (H, W, C), alpha (H, W) and median depth (H, W), front to back with the constants of 3DGS.

    Sorted by depth, or along a direction with the slopes `tilt` right and down against the optical axis.
    """
    key = (means @ view.world_to_camera[:3, :3].T + view.world_to_camera[:3, 3]) @ [*tilt, 1]
    depth, centre, flat = project(view, means, covariance, F)
    row, column = np.mgrid[: view.height, : view.width] + 0.5
    T, done = np.ones(row.shape), np.zeros(row.shape, bool)
    image, median = np.zeros((*row.shape, features.shape[1])), np.full(row.shape, np.inf)
    for g in np.argsort(key, kind="stable"):
        if depth[g] <= view.near or np.linalg.det(flat[g]) <= 0:
            continue
        offset = np.stack([column, row], axis=-1) - centre[g]
        distance = np.einsum("hwi,ij,hwj->hw", offset, np.linalg.inv(flat[g]), offset)
        alpha = np.minimum(opacity[g] * np.exp(-distance / 2), 0.99)
        alpha[alpha < 1 / 255] = 0
        done |= T * (1 - alpha) < 1e-4
        alpha[done] = 0
        image += (T * alpha)[..., None] * features[g]
        median[(T >= 0.5) & (T * (1 - alpha) < 0.5)] = depth[g]
        T = T * (1 - alpha)
    return image, 1 - T, median
