"""What fills the place of the object: no value beyond those around it, exact where the ground is linear."""

import numpy as np
import pytest

from fracsim.photo.backdrop import backdrop, filled
from fracsim.photo.outline import Outline
from fracsim.photo.reading import Photo
from tests.photo import drawn


def test_a_linear_ground_goes_on_behind_the_object() -> None:
    """A linear function is harmonic, and has no grain. The coarse grid and 8 bits leave half a level of 255 and less;
    the coarse pixels at the rim, averaged over their known part, a level or two.
    """
    ground, mask = drawn.ground().astype(np.float32), drawn.ellipse()
    spoilt = np.where(mask[..., None], np.float32([1, 0, 1]), ground)
    off = np.abs(filled(spoilt, mask) - ground)
    assert off.mean() < 0.5 / 255
    assert off.max() < 3 / 255


def test_outside_the_hole_nothing_changes() -> None:
    picture, mask = (
        np.random.default_rng(0).random((90, 120, 3)).astype(np.float32),
        drawn.ellipse(120, 90, (50, 40, 20, 20)),
    )
    assert np.array_equal(filled(picture, mask)[~mask], picture[~mask])


def test_the_fill_has_the_grain_of_the_ground() -> None:
    """Its median deviation from its own blur is that of the ground, to a third."""
    from scipy.ndimage import gaussian_filter

    rng, mask = np.random.default_rng(0), drawn.ellipse()
    picture = (drawn.ground() + rng.normal(0, 0.03, (drawn.HEIGHT, drawn.WIDTH, 1))).astype(np.float32)
    grey = filled(picture, mask).mean(axis=2)
    fine = np.abs(grey - gaussian_filter(grey, 1.5))
    inner = drawn.ellipse(at=(110, 95, 55, 33))
    assert np.median(fine[inner]) == pytest.approx(np.median(fine[~mask]), rel=0.33)


@pytest.mark.parametrize("hole", [np.zeros((20, 20), bool), np.ones((20, 20), bool)])
def test_no_hole_and_nothing_but_hole(hole: "np.ndarray[tuple[int, int], np.dtype[np.bool_]]") -> None:
    picture = np.random.default_rng(0).random((20, 20, 3)).astype(np.float32)
    assert np.array_equal(filled(picture, hole), picture)


def test_the_ground_is_where_the_camera_sees_it() -> None:
    """Seen in the size of the photo, it is the photo, apart from the hole and its rim."""
    mask = drawn.ellipse()
    one = Outline(Photo(drawn.picture(mask), None), mask)
    picture = backdrop(one, 0.6, one.view(0.6, drawn.WIDTH, 176))
    left, top, wide, _ = one.frame(drawn.WIDTH, 176)
    assert (left, wide) == (0, drawn.WIDTH)
    far = ~drawn.ellipse(at=(110, 95, 80, 58))[round(top) : round(top) + 176]
    expected = drawn.ground()[round(top) : round(top) + 176]
    assert np.abs(picture - expected)[far].max() < 1.5 / 255
