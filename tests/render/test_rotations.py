"""Rotations of deformed Gaussians: those of an SVD, and rotations for every F."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fracsim.render.rotations import rotations

TURN = Rotation.from_euler("xyz", [0.3, -0.8, 1.2]).as_matrix()
OTHER = Rotation.from_euler("xyz", [-1.1, 0.4, 0.2]).as_matrix()


def deformed(*stretches: float) -> np.ndarray:
    """F = R S with these stretches along turned axes, (1, 3, 3)."""
    return (TURN @ OTHER @ np.diag(stretches) @ OTHER.T)[None]


def assert_rotation(R: np.ndarray) -> None:
    np.testing.assert_allclose(R.transpose(0, 2, 1) @ R, np.tile(np.eye(3), (len(R), 1, 1)), atol=2e-3)
    np.testing.assert_allclose(np.linalg.det(R), 1, atol=2e-3)


@pytest.mark.parametrize("least", [1, 0.1, 1e-2, 1e-4, 1e-8, 0])
def test_a_flat_gaussian_turns_with_its_plane(least: float) -> None:
    """R of F = R S is unique as long as two stretches are not zero; the tolerance is that of float32."""
    R = rotations(deformed(2.0, 1.0, least))
    assert_rotation(R)
    np.testing.assert_allclose(R[0], TURN, atol=1e-4)


@pytest.mark.parametrize("least", [1e-2, 1e-4, 1e-6, 1e-12, 0])
@pytest.mark.parametrize("size", [1e-15, 1e-3, 1.0, 1e6])
def test_a_needle_turns_with_its_axis(least: float, size: float) -> None:
    """Of rank 1, R is open about the axis: it takes the axis along."""
    R = rotations(size * deformed(2.0, least, least))
    assert_rotation(R)
    np.testing.assert_allclose(R[0] @ OTHER[:, 0], TURN @ OTHER[:, 0], atol=5e-3)


def test_every_f_has_a_rotation() -> None:
    """Null, mirrored, tiny, huge, or not finite."""
    F = np.concatenate([
        np.zeros((1, 3, 3)), -np.eye(3)[None], np.diag([1.0, 1, -1])[None], np.ones((1, 3, 3)),
        1e-25 * deformed(1, 1, 1), 1e25 * deformed(1, 1, 1), np.full((1, 3, 3), np.nan), np.full((1, 3, 3), np.inf),
        deformed(1, 1, -1e-3), deformed(3, 1e-3, -1e-3),
    ])  # fmt: skip
    assert_rotation(rotations(F))


def test_random_ones_are_those_of_an_svd() -> None:
    rng = np.random.default_rng(0)
    F = np.eye(3) + 0.5 * rng.normal(size=(2000, 3, 3))
    R = rotations(F)
    assert_rotation(R)
    U, s, V = np.linalg.svd(F)
    U[..., 2] *= np.sign(np.linalg.det(F))[:, None]
    # R is as sensitive as the sum of the two smaller stretches is small, l3 with the sign of J.
    clear = s[:, 1] + np.sign(np.linalg.det(F)) * s[:, 2] > 0.1
    assert clear.mean() > 0.9
    np.testing.assert_allclose(R[clear], (U @ V)[clear], atol=1e-3)
