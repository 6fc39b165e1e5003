"""Gaussians that deform and rotate with the material: covariance F A F^T, colour f'(d) = f(R^T d)."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from fracsim.asset.harmonics import basis
from fracsim.records import Array, Frame, Particles
from fracsim.render.film import Film
from fracsim.verify.problem import Check, Setting, absolute

FORMULATIONS = ("total",)
"""The Gaussians are the same in both formulations."""
COUNT = 200


def deformation(rng: np.random.Generator) -> tuple[Array, Array]:
    """Random R and F = R S with stretches from 0.7 to 2.5, (COUNT, 3, 3) each."""
    R, Q = (Rotation.random(COUNT, random_state=int(rng.integers(2**31))).as_matrix() for _ in range(2))
    S = Q @ (rng.uniform(0.7, 2.5, (COUNT, 3, 1)) * Q.transpose(0, 2, 1))
    return R, R @ S


def run(setting: Setting) -> Iterator[Check]:
    """Random covariances and colours of degree 3 under random F; errors relative to the largest value."""
    rng = np.random.default_rng(0)
    R, F = deformation(rng)
    B = rng.normal(size=(COUNT, 3, 3))
    A, sh = B @ B.transpose(0, 2, 1), rng.normal(size=(COUNT, 16, 3))
    i, j = np.triu_indices(3)
    rest = Particles(X=np.zeros((COUNT, 3)), volume=np.ones(COUNT), covariance=A[:, i, j], opacity=np.ones(COUNT),
                     sh=sh, surface=np.ones(COUNT, bool), spacing=1.0)  # fmt: skip
    none = np.zeros((COUNT, 3))
    frame = Frame(0, 0.0, none, none, F, np.zeros_like(F), np.zeros(COUNT))
    _, covariance, _, turned = Film.gaussians(frame, rest)
    exact = np.einsum("nij,njk,nlk->nil", F, A, F)[:, i, j]
    yield absolute(
        "covariance, largest error / largest", 0, float(np.abs(covariance - exact).max() / exact.max()), 1e-6
    )
    d = rng.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    before = np.stack([basis(d @ R[n]) @ sh[n] for n in range(COUNT)])
    error = np.abs(np.einsum("mk,nkc->nmc", basis(d), turned) - before).max() / np.abs(before).max()
    # The tolerance is that of a float32 polar decomposition.
    yield absolute("colour, largest error / largest", 0, float(error), 1e-6)
