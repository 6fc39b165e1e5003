"""Every constitutive law found in fracsim.constitutive is hyperelastic, objective, and Hooke's law at small strain."""

from functools import cache
from typing import Any

import numpy as np
import pytest
import taichi as ti

from fracsim import registry
from fracsim.tensor import J_MIN, cofactor, principal_stretches, volume_ratio
from fracsim.verify import closed_form
from fracsim.verify.problems import confined_stretch
from fracsim.verify.problems import uniaxial as uniaxial_problem

LAWS = registry.names("fracsim.constitutive")
E, NU = 2e4, 0.45
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))


@cache
def kernel(name: str) -> Any:
    """All functions of a law for many F at once, in float64."""
    law = registry.load("fracsim.constitutive", name, "material.law")
    M = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=1)

    @ti.kernel
    def evaluate(mu: ti.f64, lam: ti.f64, F: M, P: M, out: ti.types.ndarray(dtype=ti.f64, ndim=2)):
        for p in range(F.shape[0]):
            cof = cofactor(F[p])
            J = volume_ratio(F[p], cof)
            P[p] = law.piola(F[p], cof, J, J, mu, lam)
            l = principal_stretches(F[p])
            out[p, 0] = law.psi(F[p], J, mu, lam)
            out[p, 1] = law.bound_total(l, J, J, mu, lam)
            out[p, 2] = law.bound_updated(l, J, mu, lam)

    return evaluate


def law(name: str, F: Any, mu: float = MU, lam: float = LAM) -> tuple[Any, Any, Any]:
    """psi (N,), P (N, 3, 3) and both stiffness bounds (N, 2)."""
    F = np.ascontiguousarray(F, np.float64).reshape(-1, 3, 3)
    P, out = np.zeros_like(F), np.zeros((len(F), 3))
    kernel(name)(mu, lam, F, P, out)
    return out[:, 0], P, out[:, 1:]


def random_F(n: int, seed: int = 0) -> Any:
    """Deformation gradients with stretches between 0.6 and 3 and arbitrary rotations."""
    rng = np.random.default_rng(seed)
    U, V = (np.linalg.qr(rng.normal(size=(n, 3, 3)))[0] for _ in range(2))
    U[np.linalg.det(U) < 0, :, 0] *= -1
    V[np.linalg.det(V) < 0, :, 0] *= -1
    return U @ (rng.uniform(0.6, 3.0, (n, 3, 1)) * np.swapaxes(V, 1, 2))


@pytest.mark.parametrize("name", LAWS)
def test_rest_is_free_of_energy_and_stress(name: str) -> None:
    psi, P, _ = law(name, np.eye(3))
    # Relative to E; the polar decomposition is exact to round-off.
    assert abs(psi[0]) < 1e-12 * E
    assert np.abs(P).max() < 1e-12 * E


@pytest.mark.parametrize("name", LAWS)
def test_stress_is_the_derivative_of_the_energy(name: str) -> None:
    F, step = random_F(20), 1e-5
    P = law(name, F)[1]
    numeric = np.zeros_like(P)
    for i, j in np.ndindex(3, 3):
        H = np.zeros((3, 3))
        H[i, j] = step
        numeric[:, i, j] = (law(name, F + H)[0] - law(name, F - H)[0]) / (2 * step)
    # Central differences: step^2 psi''' / 6 and round-off eps psi / step; both below 1e-8 of |P| here. The Newton
    # iteration of the fixed corotated law stops at 4 steps: 1e-6 at a stretch ratio of 5.
    assert np.abs(numeric - P).max() < 5e-6 * np.abs(P).max()


@pytest.mark.parametrize("name", LAWS)
def test_energy_does_not_see_rotation_and_tau_is_symmetric(name: str) -> None:
    F = random_F(50)
    R = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    R *= np.sign(np.linalg.det(R))
    psi, P, _ = law(name, F)
    assert np.allclose(law(name, R @ F)[0], psi, rtol=1e-9)
    tau = P @ np.swapaxes(F, 1, 2)
    assert np.abs(tau - np.swapaxes(tau, 1, 2)).max() < 5e-6 * np.abs(tau).max()


@pytest.mark.parametrize("name", LAWS)
def test_small_strain_is_hookes_law(name: str) -> None:
    eps = 1e-6
    H = eps * np.random.default_rng(2).normal(size=(3, 3))
    strain = (H + H.T) / 2
    P = law(name, np.eye(3) + H)[1][0]
    module = registry.load("fracsim.constitutive", name, "material.law")
    lam = LAM - 2 * MU / 3 if getattr(module, "LAM_IS_BULK_MODULUS", False) else LAM
    hooke = lam * np.trace(strain) * np.eye(3) + 2 * MU * strain
    # The next term is of order eps relative to this one; the moduli differ by a factor lam / mu = 9.
    assert np.abs(P - hooke).max() < 50 * eps * np.abs(hooke).max()


def uniaxial(name: str, stretch: float, nu: float) -> tuple[float, float, float]:
    """Nominal stress and Cauchy stress over E, and J, of a bar free to contract: the root of P22 = 0 by bisection."""
    mu, lam = 1 / (2 * (1 + nu)), nu / ((1 + nu) * (1 - 2 * nu))
    low, high = 0.2, 1.2
    for _ in range(60):
        mid = (low + high) / 2
        side = law(name, np.diag([stretch, mid, mid]), mu, lam)[1][0, 1, 1]
        low, high = (mid, high) if side < 0 else (low, mid)
    P = law(name, np.diag([stretch, low, low]), mu, lam)[1][0]
    J = stretch * low**2
    return P[0, 0], P[0, 0] * stretch / J, J


@pytest.mark.parametrize(("name", "nu"), uniaxial_problem.TABLE)
def test_uniaxial_stretch_with_free_sides(name: str, nu: float) -> None:
    for stretch in uniaxial_problem.STRETCHES:
        # Bisection leaves 1e-18; the fixed corotated R is good to 1e-6 at a stretch ratio of 5.
        assert uniaxial(name, stretch, nu) == pytest.approx(closed_form.uniaxial(name, nu, stretch), rel=5e-6)


@pytest.mark.parametrize("name", ["fixed_corotated", "neo_hookean"])
def test_stretch_with_held_sides(name: str) -> None:
    l = 1.7
    F = np.diag([l, 1, 1])
    tau = law(name, F)[1][0] @ F.T
    assert (tau[0, 0], tau[1, 1]) == pytest.approx(confined_stretch.kirchhoff(name, MU, LAM, l), rel=1e-6)


@pytest.mark.parametrize("name", LAWS)
def test_bounds_hold_and_are_tight_at_rest(name: str) -> None:
    """The bounds are not below the largest eigenvalue of dP/dF, and of dtau/d(ln stretch) in principal axes."""
    step = 1e-5
    rng = np.random.default_rng(3)
    crushed = np.exp(rng.uniform(np.log(0.05), np.log(3.0), (200, 3)))
    stretch = np.concatenate([np.ones((1, 3)), rng.uniform(0.6, 3.0, (40, 3)), crushed[crushed.prod(axis=1) > J_MIN]])
    F = np.array([np.diag(s) for s in stretch])
    bound = law(name, F)[2]
    tangent = np.zeros((len(F), 9, 9))
    spatial = np.zeros((len(F), 3, 3))
    for k, (i, j) in enumerate(np.ndindex(3, 3)):
        H = np.zeros((3, 3))
        H[i, j] = step
        tangent[:, k] = ((law(name, F + H)[1] - law(name, F - H)[1]) / (2 * step)).reshape(-1, 9)
    for j in range(3):
        G = np.eye(3)
        G[j, j] = np.exp(step)
        tau = [law(name, F @ g)[1] @ np.swapaxes(F @ g, 1, 2) for g in (G, np.linalg.inv(G))]
        spatial[:, :, j] = np.diagonal((tau[0] - tau[1]) / (2 * step), axis1=1, axis2=2)
    stiffest = np.linalg.eigvalsh((tangent + np.swapaxes(tangent, 1, 2)) / 2)[:, -1]
    assert (bound[:, 0] >= stiffest * (1 - 1e-4)).all()
    assert (bound[:, 1] >= np.linalg.eigvals(spatial).real.max(axis=1) * (1 - 1e-4)).all()
    assert (bound[0] <= 1.001 * (3 * LAM + 2 * MU)).all()
    if name == "fixed_corotated":  # its stiffness is finite where it is crushed, and so must the bound be
        assert (bound[:, 0] <= 3 * stiffest).all()
