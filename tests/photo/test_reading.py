"""Photos of any kind are read; what is none, or a bomb, is named. More kinds are in tests/gen/test_picture.py."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fracsim.photo import load
from fracsim.photo.reading import LONGEST
from tests.photo import drawn


def test_a_photo_of_a_phone_is_upright_and_not_too_large(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # the file's left side is the top of the picture
    image = Image.fromarray(drawn.picture(drawn.ellipse())).resize((3200, 2400))
    image.save(tmp_path / "a.jpg", exif=exif)
    photo = load(tmp_path / "a.jpg")
    assert photo.size == (LONGEST * 3 // 4, LONGEST)
    assert photo.alpha is None
    # The loaf lies left of the middle of the file, and so above the middle of the picture.
    brown = np.argwhere(photo.rgb[..., 2] < 90).mean(axis=0)
    assert brown == pytest.approx([110 / 240 * LONGEST, (1 - 95 / 180) * LONGEST * 3 / 4], rel=0.03)


@pytest.mark.parametrize("suffix", ["webp", "heic", "avif"])
def test_formats_of_phones_and_pages(suffix: str, tmp_path: Path) -> None:
    pytest.importorskip("pillow_heif").register_heif_opener()
    image = Image.fromarray(drawn.picture(drawn.ellipse()))
    try:
        image.save(tmp_path / f"a.{suffix}", quality=95)
    except (ValueError, KeyError):
        pytest.skip(f"Pillow writes no {suffix} here")
    assert np.abs(load(tmp_path / f"a.{suffix}").rgb.astype(int) - np.asarray(image)).mean() < 4


def test_a_bomb_is_refused_before_it_is_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn.save(tmp_path / "a.png")
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    with pytest.raises(ValueError, match=r"asset.path=.*a.png has more than 1000 px, which is too large"):
        load(tmp_path / "a.png")
