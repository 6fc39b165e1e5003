"""Colour from spherical harmonics: the functions, and how they turn with the material."""

import numpy as np
import pytest

from fracsim.camera import framing
from fracsim.render.sh import colour
from fracsim.render.splat import colours
from tests.reference import splat_numpy as oracle


def directions(n, seed):
    d = np.random.default_rng(seed).normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def rotations(n, seed):
    Q, R = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, 3, 3)))
    Q *= np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None, :]
    return Q * np.sign(np.linalg.det(Q))[:, None, None]


@pytest.mark.parametrize("k", [1, 4, 9, 16])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-6), (np.float32, 1e-5)])
def test_colour_is_the_textbook_sum(k, dtype, tolerance):
    """Against harmonics from the Legendre recurrence; literals inside a kernel are float32, hence 1e-6 in float64."""
    sh = np.random.default_rng(k).normal(size=(300, k, 3)).astype(dtype)
    d = 2.5 * directions(300, 1)  # any length
    np.testing.assert_allclose(colour(sh, d.astype(dtype)), oracle.colour(sh, d), atol=tolerance)


def test_first_harmonics_have_the_signs_of_3dgs():
    """Degree 1 is C1 (-y, z, -x) with C1 = sqrt(3 / 4 pi)."""
    axes = np.eye(3)[[1, 2, 0]]
    Y = oracle.harmonics(axes, 1)[:, 1:]
    np.testing.assert_allclose(Y, np.sqrt(3 / (4 * np.pi)) * np.diag([-1, 1, -1]), atol=1e-12)


def test_harmonics_of_the_oracle_are_orthonormal():
    """Over the sphere, by Gauss-Legendre in z and equal steps in phi, exact for degree 6."""
    z, weight = np.polynomial.legendre.leggauss(8)
    phi = 2 * np.pi * np.arange(16) / 16
    r = np.sqrt(1 - z * z)[:, None]
    points = np.stack([r * np.cos(phi), r * np.sin(phi), np.broadcast_to(z[:, None], (8, 16))], axis=-1).reshape(-1, 3)
    Y = oracle.harmonics(points, 3)
    gram = np.einsum("pi,pj,p->ij", Y, Y, np.repeat(weight, 16) * 2 * np.pi / 16)
    np.testing.assert_allclose(gram, np.eye(16), atol=1e-12)


def test_colour_turns_with_the_material():
    """Turning the view direction back equals turning the function: coefficients of f(R^T d), found by projection."""
    n = 40
    view = framing(np.ones(3), 0.3, 0.3, 40, 25, 10, 256, 256)
    rng = np.random.default_rng(0)
    sh, R = 0.02 * rng.normal(size=(n, 16, 3)), rotations(n, 3)  # small: 0.5 + sum stays positive
    means = 1 + 0.2 * rng.normal(size=(n, 3))
    samples = directions(200, 4)
    basis = np.linalg.pinv(oracle.harmonics(samples, 3))  # exact: a rotation keeps each degree
    turned = np.stack([basis @ oracle.harmonics(samples @ R[g], 3) @ sh[g] for g in range(n)])
    expected = oracle.colour(turned, means - view.eye)
    np.testing.assert_allclose(colours(view, means, sh, R), expected, atol=1e-6)
    assert np.abs(colours(view, means, sh, np.tile(np.eye(3), (n, 1, 1))) - expected).max() > 1e-2


def test_colour_is_not_negative():
    assert (colour(np.full((1, 1, 3), -9.0), np.array([[0.0, 0, 1]])) == 0).all()


def test_other_numbers_of_coefficients_are_an_error():
    with pytest.raises(ValueError, match="1, 4, 9 or 16"):
        colour(np.zeros((1, 5, 3)), np.ones((1, 3)))
