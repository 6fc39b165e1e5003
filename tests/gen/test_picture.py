"""A picture file as the network's reference: any file that Pillow reads, upright, on white; others are named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageDraw

from fracgen.sampling import picture

RED, BLUE = (200, 30, 20), (20, 40, 220)


def halves(width: int = 64, height: int = 32) -> Image.Image:
    """Red on the left, blue on the right."""
    image = Image.new("RGB", (width, height), RED)
    image.paste(BLUE, (width // 2, 0, width, height))
    return image


@pytest.mark.parametrize("suffix", ["png", "bmp", "tiff", "gif", "webp", "jpg"])
def test_formats_of_all_kinds_are_read(suffix: str, tmp_path: Path) -> None:
    """JPEG and WebP are lossy; a palette of 256 holds two colours."""
    halves().save(tmp_path / f"a.{suffix}", **({"quality": 100} if suffix in ("jpg", "webp") else {}))
    seen = picture.load(tmp_path / f"a.{suffix}", 64, 32).pixels
    assert seen.shape == (32, 64, 3)
    assert seen.dtype == np.uint8
    assert np.abs(seen[16, 8].astype(int) - RED).max() < 8
    assert np.abs(seen[16, 56].astype(int) - BLUE).max() < 8


@pytest.mark.parametrize("mode", ["L", "1", "P", "CMYK", "LA", "RGBA", "I;16", "I", "YCbCr"])
def test_pictures_of_all_modes_are_read(mode: str, tmp_path: Path) -> None:
    """White and black stay so; 16 bits are cut to 8."""
    grey = np.zeros((32, 64), np.uint8)
    grey[:, 32:] = 255
    if mode in ("I;16", "I"):
        image = Image.fromarray((grey.astype(np.uint16) * 257).astype(np.uint16 if mode == "I;16" else np.int32))
    else:
        image = Image.fromarray(grey).convert(mode)
    file = tmp_path / f"a.{'png' if mode in ('L', '1', 'P', 'LA', 'RGBA', 'I;16') else 'tiff'}"
    image.save(file)
    seen = picture.load(file, 64, 32).pixels
    assert (seen[16, 8] <= 2).all()
    assert (seen[16, 56] >= 253).all()


def test_orientation_of_exif_is_followed(tmp_path: Path) -> None:
    """Orientation 6: the file's left side is the top of the picture."""
    exif = Image.Exif()
    exif[0x0112] = 6
    halves().save(tmp_path / "a.png", exif=exif)
    seen = picture.load(tmp_path / "a.png", 32, 64).pixels
    assert seen[8, 16].tolist() == list(RED)
    assert seen[56, 16].tolist() == list(BLUE)


def test_the_object_may_be_shown_alone_on_white(tmp_path: Path) -> None:
    """A red disc on blue: found by its colour, or by a mask of another size; `none` keeps the ground."""
    image, mask = Image.new("RGB", (64, 64), BLUE), Image.new("L", (128, 128), 0)
    ImageDraw.Draw(image).ellipse((16, 16, 48, 48), fill=RED)
    ImageDraw.Draw(mask).ellipse((32, 32, 96, 96), fill=255)
    image.save(tmp_path / "a.png")
    mask.save(tmp_path / "mask.png")
    assert picture.cutout(tmp_path / "a.png", "none", "") is None
    for method, file in (("border", ""), ("none", str(tmp_path / "mask.png"))):
        found = picture.cutout(tmp_path / "a.png", method, file)
        assert found is not None
        assert found.mean() == pytest.approx(np.pi / 4 * (33 / 64) ** 2, rel=0.05)  # corners included
        seen = picture.load(tmp_path / "a.png", 64, 64, shown=found).pixels
        assert (seen[32, 32].tolist(), seen[4, 4].tolist()) == (list(RED), [255, 255, 255])


@pytest.mark.parametrize(("method", "mask", "message"), [
    ("scissors", "", r"cutout=scissors is not known"),
    ("border", "", r"cutout=border.*no object|cutout=border.*cannot be cut out.*give its outline by mask=FILE"),
    ("none", "gone.png", r"mask=gone\.png is not a file"),
])  # fmt: skip
def test_what_cannot_be_cut_out_is_named(method: str, mask: str, message: str, tmp_path: Path) -> None:
    Image.new("RGB", (64, 64), BLUE).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match=message) as told:
        picture.cutout(tmp_path / "a.png", method, mask)
    assert "asset." not in str(told.value)


def test_transparent_parts_are_white_and_half_transparent_ones_half(tmp_path: Path) -> None:
    image = Image.new("RGBA", (32, 32), (100, 0, 0, 0))
    image.paste((100, 0, 0, 128), (0, 0, 16, 32))
    image.save(tmp_path / "a.png")
    seen = picture.load(tmp_path / "a.png", 32, 32).pixels
    assert seen[16, 24].tolist() == [255, 255, 255]
    assert np.abs(seen[16, 8].astype(int) - [177, 127, 127]).max() <= 1


def test_another_shape_is_fitted_on_white(tmp_path: Path) -> None:
    """64 x 32 on 32 x 32: half as large, with bands of 8 px above and below."""
    halves().save(tmp_path / "a.png")
    seen = picture.load(tmp_path / "a.png", 32, 32, "fit")
    assert (seen.pixels[:8] == 255).all()
    assert (seen.pixels[24:] == 255).all()
    assert seen.pixels[16, 4].tolist() == list(RED)
    assert (seen.corner, seen.size) == ((0, 0.25), (1, 0.5))


def test_another_shape_is_cropped_to_its_middle(tmp_path: Path) -> None:
    halves().save(tmp_path / "a.png")
    seen = picture.load(tmp_path / "a.png", 32, 32, "crop")
    assert seen.pixels[4, 4].tolist() == list(RED)
    assert seen.pixels[4, 27].tolist() == list(BLUE)
    assert (seen.corner, seen.size) == ((-0.5, 0), (2, 1))


def test_a_picture_of_the_right_size_is_left_as_it_is(tmp_path: Path) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (32, 48, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    for fit in ("fit", "crop"):
        seen = picture.load(tmp_path / "a.png", 48, 32, fit)
        assert np.array_equal(seen.pixels, pixels)
        assert (seen.corner, seen.size) == ((0, 0), (1, 1))


def _text(path: Path) -> None:
    path.write_text("no picture")


def _cut(path: Path) -> None:
    whole = path.with_suffix(".whole.png")
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8)).save(whole)
    path.write_bytes(whole.read_bytes()[:3000])


def _floating(path: Path) -> None:
    Image.fromarray(np.zeros((32, 32), np.float32)).save(path, format="TIFF")


@pytest.mark.parametrize(("make", "message"), [
    (_text, "UnidentifiedImageError"), (lambda path: path.mkdir(), "Error"),
    (_cut, "truncated"), (_floating, "floating-point pixels"),
    (lambda path: path.write_bytes(b""), "UnidentifiedImageError"),
])  # fmt: skip
def test_what_is_no_picture_is_named(make: Any, message: str, tmp_path: Path) -> None:
    make(tmp_path / "cake.png")
    with pytest.raises(ValueError, match=rf"image=.*cake\.png cannot be read as a picture .*{message}.*give a PNG"):
        picture.load(tmp_path / "cake.png", 32, 32)


def test_a_picture_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"image=.*cake\.png is not a file, seen from .*: correct the path"):
        picture.load(tmp_path / "cake.png", 32, 32)


def test_a_picture_that_is_too_small_is_named(tmp_path: Path) -> None:
    halves(64, 15).save(tmp_path / "cake.png")
    with pytest.raises(ValueError, match=r"image=.*cake\.png has 64 x 15 px, which is too small: .* at least 16 px"):
        picture.load(tmp_path / "cake.png", 32, 32)


@pytest.mark.parametrize("limit", [1500, 600])
def test_a_picture_that_is_too_large_is_named_before_it_is_decoded(
    limit: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2048 px; Pillow warns above its limit and refuses above twice of it."""
    halves().save(tmp_path / "cake.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", limit)
    with pytest.raises(ValueError, match=rf"image=.*cake\.png has more than {limit} px, which is too large"):
        picture.load(tmp_path / "cake.png", 32, 32)
