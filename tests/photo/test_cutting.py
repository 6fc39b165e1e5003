"""What is drawn is found, whatever says where it is; what cannot be found is said, with the way out."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fracsim.photo import Photo, cut, cutting, load
from fracsim.photo.cutouts import border
from tests.photo import drawn


@pytest.mark.parametrize("method", ["auto", "grabcut", "border"])
def test_an_object_on_a_table_is_found(method: str, tmp_path: Path) -> None:
    """The outline is off by half a pixel of the picture at most: 2 (a + b) / (a b) of a half is 4 % of the area."""
    found = cut(load(drawn.save(tmp_path / "loaf.png")), method)
    assert drawn.overlap(found, drawn.ellipse()) > 0.96


def test_a_hole_that_shows_the_ground_stays_and_specks_go(tmp_path: Path) -> None:
    ring = drawn.ellipse() & ~drawn.ellipse(at=(110, 95, 26, 18))
    marks = ring.copy()
    marks[95, 46:50] = False  # a scratch
    marks[5:8, 5:8] = True  # a crumb
    found = cutting.whole(marks, load(drawn.save(tmp_path / "ring.png", ring)), "mask")
    assert np.array_equal(found, ring)


def test_opacity_comes_first(tmp_path: Path) -> None:
    mask = drawn.ellipse(at=(60, 60, 30, 40))  # not where the colours are
    pixels = np.dstack([drawn.picture(drawn.ellipse()), np.where(mask, 255, 0).astype(np.uint8)])
    Image.fromarray(pixels).save(tmp_path / "cut.png")
    assert np.array_equal(cut(load(tmp_path / "cut.png")), mask)


def test_a_picture_with_a_soft_edge_only_is_not_taken_for_cut_out(tmp_path: Path) -> None:
    alpha = np.full((drawn.HEIGHT, drawn.WIDTH), 255, np.uint8)
    alpha[0] = 200
    Image.fromarray(np.dstack([drawn.picture(drawn.ellipse()), alpha])).save(tmp_path / "soft.png")
    assert drawn.overlap(cut(load(tmp_path / "soft.png")), drawn.ellipse()) > 0.96


@pytest.mark.parametrize("mode", ["L", "RGBA"])
def test_a_mask_file_says_it_all(mode: str, tmp_path: Path) -> None:
    """White on black, or opaque on transparent; of any size in the shape of the photo."""
    photo, mask = load(drawn.save(tmp_path / "loaf.png")), drawn.ellipse(at=(60, 60, 30, 40))
    values = np.where(mask, 255, 0).astype(np.uint8)
    pixels = values if mode == "L" else np.dstack([np.full((*mask.shape, 3), 90, np.uint8), values])
    Image.fromarray(pixels).resize((2 * drawn.WIDTH, 2 * drawn.HEIGHT), Image.Resampling.NEAREST).save(
        tmp_path / "m.png"
    )
    assert drawn.overlap(cutting.of_file(str(tmp_path / "m.png"), photo), mask) > 0.99


def test_a_cutout_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text('"""Mine."""\n\ndef cut(photo):\n    return photo.rgb[..., 2] < 100\n')
    photo = load(drawn.save(tmp_path / "loaf.png"))
    assert drawn.overlap(cut(photo, str(tmp_path / "mine.py")), drawn.ellipse()) > 0.95


def _plain(photo: Photo) -> Photo:
    return Photo(np.full_like(photo.rgb, 200), None, photo.name)


@pytest.mark.parametrize(("method", "change", "message"), [
    ("auto", _plain, r"asset.cutout=auto finds no object in asset.path=.*asset.mask=FILE"),
    ("border", _plain, r"asset.cutout=border finds no object"),
    ("alpha", lambda p: p, r"asset.cutout=alpha: .* cannot be cut out \(the file has no transparent parts\)"),
    ("grabcat", lambda p: p, r"asset.cutout=grabcat is not known.*Did you mean grabcut"),
    ("rembg", lambda p: p, r"asset.cutout=rembg needs rembg, which is not installed"),
])  # fmt: skip
def test_what_cannot_be_found_is_said(method: str, change: Any, message: str, tmp_path: Path) -> None:
    photo = change(load(drawn.save(tmp_path / "loaf.png")))
    with pytest.raises(ValueError, match=message):
        cut(photo, method)


def test_without_opencv_the_way_out_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ValueError, match=r"asset.cutout=auto needs cv2.*pip install 'fracsim\[photo\]'.*border"):
        cut(load(drawn.save(tmp_path / "loaf.png")))


@pytest.mark.parametrize(("pixels", "message"), [
    (np.zeros((180, 240), np.uint8), "finds no object"),
    (np.full((180, 240), 255, np.uint8), "finds no ground beside the object"),
    (np.zeros((180, 180), np.uint8), "180 x 180 px, another shape than"),
])  # fmt: skip
def test_a_mask_that_says_nothing_is_refused(pixels: Any, message: str, tmp_path: Path) -> None:
    Image.fromarray(pixels).save(tmp_path / "m.png")
    with pytest.raises(ValueError, match=f"asset.mask=.*m.png.*{message}"):
        cutting.of_file(str(tmp_path / "m.png"), load(drawn.save(tmp_path / "loaf.png")))


def test_otsus_threshold_parts_two_heaps() -> None:
    """Of two heaps far apart, any value between them parts them."""
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(1, 0.1, 500), rng.normal(5, 0.3, 300)])
    assert 1.5 < border.threshold(values) < 4
