"""Particles of a photo: the front view at rest is the photo, the volume that of the body."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracsim import Run, Scene, compose
from fracsim.asset.build import build
from fracsim.asset.frame import LatticeFrame
from fracsim.photo.outline import outline
from fracsim.records import Array
from fracsim.scene.vocab import Asset
from tests.photo import drawn

SPACING = 0.6 / 40


@pytest.fixture(scope="module")
def photo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drawn.save(tmp_path_factory.mktemp("photo") / "loaf.png")


def asset(path: Path, **more: Any) -> Asset:
    return Asset(kind="image", path=str(path), cutout="border", **more)


def test_an_elliptical_outline_becomes_an_ellipsoid(photo: Path) -> None:
    """u of an ellipse is 1 - (x/a)^2 - (y/b)^2, so the body is an ellipsoid: V = 4/3 pi a b c with c = depth b.

    The outline is the found one. Perspective: every slice z is (1 - z/D)^2 of its area, D = 4 sizes: 0.2 % of V.
    """
    one = asset(photo, depth=0.8)
    particles = build(one, SPACING, 0)
    a, b = (np.diff(outline(one).box, axis=0)[0] / outline(one).extent) * 0.6 / 2
    volume = 4 / 3 * np.pi * a * b * 0.8 * b
    assert particles.volume.sum() == pytest.approx(volume, rel=0.03)
    lo, hi = particles.X.min(axis=0) - 1, particles.X.max(axis=0) - 1
    assert np.array([lo, hi]) == pytest.approx(np.array([[-a, -b, -0.8 * b], [a, b, 0.8 * b]]), abs=0.6 * SPACING)


@pytest.mark.parametrize("more", [{"back": "flat"}, {"base": "flat"}, {"back": "flat", "base": "flat"}])
def test_flat_sides_are_flat_and_the_box_is_centred(more: dict[str, str], tmp_path: Path) -> None:
    """Particles of a flat side lie at one depth below it; the body's middle is at CENTRE."""
    half = drawn.ellipse() & (np.arange(drawn.HEIGHT) < 100)[:, None]
    X = build(asset(drawn.save(tmp_path / "half.png", half), **more), SPACING, 0).X
    assert (X.min(axis=0) + X.max(axis=0)) / 2 == pytest.approx(np.ones(3), abs=0.75 * SPACING)
    for axis in [2] * ("back" in more) + [1] * ("base" in more):
        lowest = X[:, axis].min()
        layer = X[X[:, axis] < lowest + 0.5 * SPACING]
        spread = np.ptp(layer, axis=0)[[k for k in range(3) if k != axis]]
        assert (spread > 0.14).all()
        assert layer[:, axis].std() < 0.15 * SPACING


def test_the_skin_has_no_volume_and_the_frame_changes_none(photo: Path) -> None:
    """At least 200 of the skin along the outline, so 200^2 pi / 4 * 2/3 in it; they are drawn only."""
    straight, turned = build(asset(photo), SPACING, 0), build(asset(photo), SPACING, 0, 30.0)
    for one in (straight, turned):
        assert (one.volume == 0).sum() == pytest.approx(200**2 * np.pi / 4 * 2 / 3, rel=0.05)
        assert one.surface[one.volume == 0].all()
    assert turned.volume.sum() == pytest.approx(straight.volume.sum(), rel=0.01)
    front = LatticeFrame(0.0).points(turned.X)[turned.surface]
    assert front.min(axis=0) == pytest.approx(straight.X[straight.surface].min(axis=0), abs=0.3 * SPACING)


def test_inside_is_crumb_of_the_wanted_colour(photo: Path) -> None:
    """Deeper than two spacings the photo's colour is gone; the grain varies by 12 % at most."""
    one = build(asset(photo, interior="#f0e0a0"), SPACING, 0)
    rgb = 0.5 + 0.28209479 * one.sh[:, 0]
    deep = np.linalg.norm((one.X - 1) / (0.3, 0.2, 0.14), axis=1) < 0.5
    assert rgb[deep].mean(axis=0) == pytest.approx(np.array([0xF0, 0xE0, 0xA0]) / 255, rel=0.03)


@pytest.mark.parametrize(("path", "more", "message"), [
    ("nowhere.png", {}, "nowhere.png is not a file"), ("loaf.png", {"size": 0.02, "depth": 0.05}, "too thin"),
])  # fmt: skip
def test_what_cannot_be_used_is_named(path: str, more: dict[str, Any], message: str, photo: Path) -> None:
    with pytest.raises(ValueError, match=message):
        build(asset(photo.with_name(path), **more), SPACING, 0)


def test_a_line_is_no_body(tmp_path: Path) -> None:
    line = np.zeros((drawn.HEIGHT, drawn.WIDTH), bool)
    line[88:91, 20:220] = True
    with pytest.raises(
        ValueError, match=r"line\.png: the object in the photo cannot be inflated, since it is nowhere wider"
    ):
        build(asset(drawn.save(tmp_path / "line.png", line)), SPACING, 0)


def rest(photo: Path, *more: str) -> tuple[Scene, Array, Array]:
    """A scene, and colour and coverage of its frame 0."""
    scene = compose("asset=image", f"asset.path={photo}", "quality=preview", "capture.frames=1",
                    "capture.maps=[]", "backend.threads=1", *more)  # fmt: skip
    run = Run(scene)
    picture = run._film.shoot(next(run.frames()), run.particles)
    assert picture.rgb is not None
    assert picture.alpha is not None
    return run.scene, picture.rgb / 255, picture.alpha


@pytest.mark.parametrize("quality", ["preview", "default"])
def test_the_front_view_at_rest_is_the_photo(quality: str, tmp_path: Path) -> None:
    """At least 30 dB inside the outline, with waves as short as 9 px of the photo. Outside it is the photo itself.

    The object is found by a file, so that no error of finding counts.
    """
    from PIL import Image

    mask = drawn.ellipse()
    photo = drawn.save(tmp_path / "loaf.png")
    Image.fromarray(np.where(mask, 255, 0).astype(np.uint8)).save(tmp_path / "mask.png")
    size = (f"quality={quality}", "camera.width=240", "camera.height=176", "camera.background=photo")
    scene, rgb, alpha = rest(photo, f"asset.mask={tmp_path / 'mask.png'}", *size)
    top = round(outline(scene.asset).frame(240, 176)[1])
    expected = drawn.picture(mask)[top : top + 176] / 255
    inside, beyond = (drawn.ellipse(at=(110, 95, a, b))[top : top + 176] for a, b in ((65, 43), (76, 54)))
    error = rgb - expected
    assert -10 * np.log10(np.mean(error[inside] ** 2)) > 30
    assert np.abs(error[~beyond]).max() < 3 / 255
    assert alpha[inside].mean() > 0.995
    assert alpha[~beyond].max() < 0.02


def test_a_white_ground_shows_the_whole_travel_from_the_same_distance(photo: Path) -> None:
    """The picture is another cut of what the photo's camera sees: the outline has the same shape."""
    scene, rgb, alpha = rest(photo, "loading.speed=0.2")
    assert np.abs(rgb[:8] - 1).max() == 0
    rows, columns = np.flatnonzero(alpha.max(axis=1) > 0.5), np.flatnonzero(alpha.max(axis=0) > 0.5)
    lo, hi = outline(scene.asset).box
    assert len(columns) / len(rows) == pytest.approx((hi - lo)[0] / (hi - lo)[1], rel=0.03)
