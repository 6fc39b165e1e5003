"""The skin of an object from a photo: Gaussians in a square lattice of the picture, which lie on the front.

What is nearer to the eye hides more of its neighbours than they of it. So the colours that Gaussians have are not those
of the picture where they lie, but such that their composite has those there.
"""

import numpy as np

from fracsim.asset.gaussians import OPACITY
from fracsim.records import Array

WIDE, THIN = 0.45, 0.15
"""Standard deviations of a Gaussian along the picture and across the surface [distances in the lattice]."""
PIXEL = 0.6
"""Size of a pixel for which colours are made [distances in the lattice]."""
LOWPASS = 0.3
"""Variance that the renderer adds to each Gaussian [px^2] (Kerbl et al. 2023)."""
STEEP = 2.0
"""Largest slope of the surface at which a Gaussian lies flat on it."""
NEIGHBOURS = 2
"""Gaussians count in the composite at others as many rows and columns away."""
ROUNDS = 12


def covariances(slope: Array, pitch: float) -> tuple[Array, Array]:
    """Covariances (N, 3, 3) of Gaussians on a surface z(x, y) of `slope` (N, 2), `pitch` apart, and its normals (N, 3).

    Seen along z each is round and reaches WIDE pitches, however steep the surface is, up to STEEP.
    """
    slope = slope * np.minimum(1, STEEP / np.maximum(np.linalg.norm(slope, axis=1), 1e-9))[:, None]
    one, none = np.ones(len(slope)), np.zeros(len(slope))
    normal = np.column_stack([-slope, one])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    right, up = np.column_stack([one, none, slope[:, 0]]), np.column_stack([none, one, slope[:, 1]])
    A = sum(np.einsum("ni,nj->nij", t, t) for t in (right, up)) * (WIDE * pitch) ** 2
    out: Array = A + np.einsum("ni,nj->nij", normal, normal) * (THIN * pitch) ** 2
    return out, normal


def sharpened(wanted: Array, index: Array, height: Array) -> Array:
    """Colours (N, 3) whose composite at each Gaussian is `wanted` (N, 3), as nearly as colours in [0, 1] allow.

    `index` (N, 2) are columns and rows in the lattice, `height` (N,) is z, towards the eye. Behind the skin are the
    wanted colours themselves.
    """
    weight, neighbour = _weights(index, height)
    behind = (1 - weight.sum(axis=1))[:, None] * wanted
    colour: Array = wanted.copy()
    for _ in range(ROUNDS):
        seen = np.einsum("nk,nkc->nc", weight, colour[neighbour]) + behind
        colour = np.clip(colour + (wanted - seen), 0, 1)
    return colour


def _weights(index: Array, height: Array) -> tuple[Array, Array]:
    """Weights of the Gaussians about each one in the composite at its centre, and which these are, (N, K) each."""
    reach = range(-NEIGHBOURS, NEIGHBOURS + 1)
    steps = np.array([(i, j) for i in reach for j in reach])
    low = index.min(axis=0) - NEIGHBOURS
    number = np.full(index.max(axis=0) - low + NEIGHBOURS + 1, -1)
    number[tuple((index - low).T)] = np.arange(len(index))
    beside = index[:, None] + steps - low
    neighbour = number[beside[..., 0], beside[..., 1]]
    variance = WIDE**2 + LOWPASS * PIXEL**2
    alpha = OPACITY * np.exp(-(steps**2).sum(axis=1) / (2 * variance)) * (neighbour >= 0)
    order = np.argsort(-np.where(neighbour >= 0, height[neighbour], -np.inf), axis=1, kind="stable")
    alpha, neighbour = (np.take_along_axis(a, order, axis=1) for a in (alpha, neighbour))
    passed = np.cumprod(1 - alpha, axis=1)
    weight = alpha * np.concatenate([np.ones((len(index), 1)), passed[:, :-1]], axis=1)
    return weight, np.maximum(neighbour, 0)
