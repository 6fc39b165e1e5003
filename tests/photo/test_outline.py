"""Where a photo lies in the world, and what its camera sees."""

from pathlib import Path

import numpy as np
import pytest

from fracsim.camera import project
from fracsim.photo.outline import Outline, outline
from fracsim.photo.reading import Photo
from fracsim.scene.vocab import CENTRE, Asset
from tests.photo import drawn

SIZES = [(256, 256), (512, 256), (128, 512), (240, 176)]


def seen(at: tuple[float, float, float, float] = drawn.LOAF) -> Outline:
    mask = drawn.ellipse(at=at)
    return Outline(Photo(drawn.picture(mask), None), mask)


def test_the_box_is_that_of_the_pixels() -> None:
    lo, hi = seen((100, 90, 50, 30)).box
    assert (lo.tolist(), hi.tolist()) == ([50, 60], [150, 120])
    assert seen((100, 90, 50, 30)).extent == 100


def test_plane_and_photo_are_inverse_and_up_is_up() -> None:
    one = seen((100, 90, 50, 30))
    assert one.to_plane(np.array([[100, 90], [150, 90], [100, 60]])) == pytest.approx(
        np.array([[0, 0], [0.5, 0], [0, 0.3]])
    )
    points = np.random.default_rng(0).normal(size=(9, 2))
    assert one.to_plane(one.to_photo(points)) == pytest.approx(points)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("at", [drawn.LOAF, (120, 90, 118, 88), (30, 150, 28, 28), (120, 90, 10, 80)])
def test_a_frame_holds_the_object_in_the_shape_of_the_picture(
    size: tuple[int, int], at: tuple[float, float, float, float]
) -> None:
    """It stays within the photo along each edge where it is not longer than the photo."""
    one = seen(at)
    left, top, wide, high = one.frame(*size)
    assert wide / high == pytest.approx(size[0] / size[1])
    lo, hi = one.box
    assert left <= lo[0]
    assert top <= lo[1]
    assert left + wide >= hi[0]
    assert top + high >= hi[1]
    if wide <= drawn.WIDTH and lo[0] > 0.05 * drawn.WIDTH and hi[0] < 0.95 * drawn.WIDTH:
        assert left >= 0
        assert left + wide <= drawn.WIDTH


def test_the_frame_of_a_picture_of_the_same_shape_is_the_whole_photo() -> None:
    assert seen((110, 95, 50, 40)).frame(480, 360) == pytest.approx((0, 0, drawn.WIDTH, drawn.HEIGHT))


@pytest.mark.parametrize("size", SIZES)
def test_the_camera_sees_the_plane_of_the_photo_as_the_frame(size: tuple[int, int]) -> None:
    """A point of the photo, put into the world, is projected to where it is in the frame."""
    one = seen()
    left, top, wide, high = one.frame(*size)
    at = np.random.default_rng(0).uniform(0, 180, (20, 2))
    world = np.column_stack([0.4 * one.to_plane(at), np.zeros(20)]) + CENTRE
    xy, depth = project(one.view(0.4, *size), world)
    assert xy == pytest.approx((at - (left, top)) * (size[0] / wide, size[1] / high), abs=1e-6)
    assert depth == pytest.approx(np.full(20, 1.6))  # four times the size


def test_colours_are_those_of_the_object_alone() -> None:
    """A mean over many pixels at the edge holds nothing of the ground."""
    mask = drawn.ellipse()
    pixels = np.where(mask[..., None], (200, 100, 50), (0, 255, 0)).astype(np.uint8)
    one = Outline(Photo(pixels, None), mask)
    edge = one.to_plane(np.column_stack([110 + 65 * np.cos(np.arange(20)), 95 + 43 * np.sin(np.arange(20))]))
    assert one.colours(edge, 0.1) == pytest.approx(np.tile(np.array([200, 100, 50]) / 255, (20, 1)), abs=0.005)


def test_an_edited_mask_is_read_anew(tmp_path: Path) -> None:
    from PIL import Image

    photo, mask = drawn.save(tmp_path / "a.png"), tmp_path / "m.png"
    asset = Asset(kind="image", path=str(photo), mask=str(mask))
    for at in ((60, 60, 30, 40), (160, 100, 30, 40)):
        Image.fromarray(np.where(drawn.ellipse(at=at), 255, 0).astype(np.uint8)).save(mask)
        assert np.array_equal(outline(asset).mask, drawn.ellipse(at=at))
