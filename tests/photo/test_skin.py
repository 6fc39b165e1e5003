"""Colours of the skin: their composite is the picture. The oracle composites one Gaussian after the other."""

import numpy as np
import pytest

from fracsim.asset import skin
from fracsim.asset.gaussians import OPACITY
from fracsim.records import Array


def lattice(n: int) -> Array:
    return np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2)


def composite(colour: Array, index: Array, height: Array, at: Array, behind: Array) -> Array:
    """The colour (3,) at one point, front to back."""
    variance = skin.WIDE**2 + skin.LOWPASS * skin.PIXEL**2
    seen, left = np.zeros(3), 1.0
    for k in np.argsort(-height, kind="stable"):
        alpha = OPACITY * np.exp(-((index[k] - at) ** 2).sum() / (2 * variance))
        seen, left = seen + left * alpha * colour[k], left * (1 - alpha)
    return np.asarray(seen + left * behind)


def test_the_composite_of_sharpened_colours_is_the_picture() -> None:
    """A slope, so that each hides those behind it; waves as short as five Gaussians. Without it the error is large."""
    index = lattice(14)
    height = 0.5 * index[:, 0] + 0.3 * index[:, 1]
    wanted = 0.5 + 0.2 * np.sin(2 * np.pi * index[:, [0, 1, 0]] / (5, 7, 9))
    made = skin.sharpened(wanted, index, height)
    middle = [k for k, (i, j) in enumerate(index) if 4 <= i < 10 and 4 <= j < 10]

    def error(colour: Array) -> float:
        seen = [composite(colour, index, height, index[k], wanted[k]) for k in middle]
        return float(np.abs(np.array(seen) - wanted[middle]).max())

    assert error(made) < 0.01
    assert error(wanted) > 0.04


def test_one_colour_stays() -> None:
    index, wanted = lattice(6), np.tile([0.7, 0.4, 0.1], (36, 1))
    assert skin.sharpened(wanted, index, np.zeros(36)) == pytest.approx(wanted)


def test_seen_along_z_a_gaussian_is_round_however_steep_the_surface() -> None:
    slope = np.array([[0.0, 0.0], [1.0, 0.0], [0.8, -1.2], [30.0, 40.0]])
    A, normal = skin.covariances(slope, 0.01)
    wide, thin = (skin.WIDE * 0.01) ** 2, (skin.THIN * 0.01) ** 2
    for one, n in zip(A, normal, strict=True):
        assert one[:2, :2] == pytest.approx(wide * np.eye(2) + thin * np.outer(n, n)[:2, :2])
        assert n @ one @ n == pytest.approx(thin, rel=1e-6)
    assert np.linalg.norm(normal[3][:2]) / normal[3][2] == pytest.approx(skin.STEEP)
