"""Tensor algebra against NumPy's SVD, and B-spline moments."""

import numpy as np
import taichi as ti

from fracsim.mpm.bspline import stencil, weights
from fracsim.render.rotations import rotations
from fracsim.tensor import cofactor, max_stretch, principal_stretches, rotation

from .test_constitutive import random_F

Matrices = ti.types.ndarray(dtype=ti.types.matrix(3, 3, ti.f64), ndim=1)
Vectors = ti.types.ndarray(dtype=ti.types.vector(3, ti.f64), ndim=1)


@ti.kernel
def decompose(F: Matrices, R: Matrices, l: Vectors, largest: Vectors):
    for p in range(F.shape[0]):
        R[p] = rotation(F[p], cofactor(F[p]))
        l[p] = principal_stretches(F[p])
        J = F[p].determinant()
        near, far = max_stretch(F[p], J, 0.9 * l[p][0]), max_stretch(F[p], J, l[p][0] + 0.1)
        largest[p] = ti.Vector([near, far, near * 0])


def test_polar_rotation_and_principal_stretches() -> None:
    F = random_F(200)
    R, l, largest = np.zeros_like(F), np.zeros((len(F), 3)), np.zeros((len(F), 3))
    decompose(F, R, l, largest)
    U, s, Vt = np.linalg.svd(F)
    # The last of Newton's steps was at most 3.2e-5 |F|; the error is 3/4 of its square, divided by the slope of 16.
    assert np.abs(R - U @ Vt).max() < 3e-9
    # 2 pi / 3 is a float32 literal: 1e-8 in the angle of the smallest root.
    assert np.abs(l - s).max() < 1e-6
    # max_stretch is a closed form; acos loses half the digits where two stretches agree.
    assert np.abs(largest[:, 0] - s[:, 0]).max() < 1e-7


def test_rotation_holds_at_extreme_stretches() -> None:
    """Five quadratic steps."""
    F = random_F(50) @ np.diag([12.0, 1.0, 0.1])
    R, l, largest = np.zeros_like(F), np.zeros((len(F), 3)), np.zeros((len(F), 3))
    decompose(F, R, l, largest)
    U, _, Vt = np.linalg.svd(F)
    assert np.abs(R - U @ Vt).max() < 1e-12


def test_inverted_F_gets_a_rotation_that_takes_the_smallest_stretch_as_negative() -> None:
    F = random_F(50)
    U, _, Vt = np.linalg.svd(F)
    turned = U @ (np.array([1.5, 1.0, -0.3])[:, None] * Vt)
    R, l, largest = np.zeros_like(F), np.zeros((len(F), 3)), np.zeros((len(F), 3))
    decompose(turned, R, l, largest)
    assert np.abs(R - U @ Vt).max() < 1e-7  # five steps, from further off and towards a root with a smaller slope


def test_max_stretch_stops_below_its_floor() -> None:
    F = np.tile(np.diag([1.3, 0.9, 0.9]), (1, 1, 1))
    R, l, largest = np.zeros_like(F), np.zeros((1, 3)), np.zeros((1, 3))
    decompose(F, R, l, largest)
    assert largest[0, 1] == 0


def test_single_precision_rotation() -> None:
    F = random_F(100)
    U, _, Vt = np.linalg.svd(F)
    assert np.abs(rotations(F) - U @ Vt).max() < 3e-6


@ti.kernel
def moments(y: Vectors, out: Vectors, squares: Vectors):
    for p in range(y.shape[0]):
        base, f = stencil(y[p])
        total, first, second = y[p] * 0, y[p] * 0, y[p] * 0
        for axis in ti.static(range(3)):
            w = weights(f[axis])
            for k in ti.static(range(3)):
                at = base[axis] + k
                total[axis] += w[k]
                first[axis] += w[k] * at
                second[axis] += w[k] * (at - y[p][axis]) ** 2
        out[p] = first - y[p] + total - 1
        squares[p] = second


def test_weights_sum_to_one_reproduce_position_and_have_constant_inertia() -> None:
    y = np.random.default_rng(0).uniform(2, 9, (300, 3))
    out, squares = np.zeros_like(y), np.zeros_like(y)
    moments(y, out, squares)
    assert np.abs(out).max() < 1e-13
    # sum w (x_i - x_p)^2 = h^2 / 4 for quadratic B-splines, wherever the particle is.
    assert np.abs(squares - 0.25).max() < 1e-13
