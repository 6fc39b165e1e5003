"""A condition file and the photo's camera become fields of the scene, in closed form, and back."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracgen import conditioning
from fracsim import Scene, compose
from fracsim.photo.outline import outline
from fracsim.photo.stage import staged
from fracsim.sample import scene_id
from fracsim.scene import condition
from fracsim.scene.condition import Condition
from tests.photo import drawn

SIZE = (110 / 240, 95 / 180)
"""Centre of the loaf in widths and heights of the photo."""


def pulled(angle: float, reach: float, speed: float, **more: Any) -> Condition:
    """Grips at `reach` [px] from the loaf's centre along `angle` [deg], moving at `speed` [px/s]."""
    axis = np.array([np.cos(np.radians(angle)), -np.sin(np.radians(angle))]) / (240, 180)
    ends = np.concatenate([-axis, axis])
    return Condition(grips=(np.tile(SIZE, 2) + reach * ends).tolist(), velocity=(speed * ends).tolist(), **more)


def scene(folder: Path, given: Condition | None = None, *more: str) -> Scene:
    path = drawn.save(folder / "loaf.png")
    if given is not None:
        condition.save(given, folder / "pull.json")
        more = (*more, f"condition={folder / 'pull.json'}")
    return compose("asset=image", f"asset.path={path}", "asset.cutout=border", *more)


def centred(one: Scene) -> tuple[float, float]:
    """How far the found centre is off the drawn one [widths, heights]."""
    x, y = outline(one.asset).centre / (240, 180)
    return x - SIZE[0], y - SIZE[1]


@pytest.mark.parametrize("angle", [0.0, 37.5, 90.0, 120.0, -30.0])
def test_pixels_become_metres(angle: float, tmp_path: Path) -> None:
    """The loaf is 132 px wide and 0.6 m large; finding it is exact to a pixel."""
    made = staged(scene(tmp_path, pulled(angle, 33.0, 44.0))).loading
    scale = 0.6 / 132
    assert made.axis_deg == pytest.approx(angle)
    assert (made.offset, made.speed) == pytest.approx((33 * scale, 44 * scale), rel=0.02)


def test_material_and_thresholds_are_those_of_the_file(tmp_path: Path) -> None:
    given = pulled(0, 33, 44, E=3.5e4, nu=0.41, category="high_stretch", onset=2.6, crit=3.1, fps=60)
    made = staged(scene(tmp_path, given))
    rubber = compose("material=rubber").material
    assert made.material == replace(rubber, E=3.5e4, nu=0.41)
    assert (made.fracture.onset, made.fracture.crit, made.capture.fps) == (2.6, 3.1, 60)


def test_a_material_of_the_same_kind_is_kept(tmp_path: Path) -> None:
    given = pulled(0, 33, 44, category="high_stretch", onset=2.6, crit=3.1)
    made = staged(scene(tmp_path, given, "material=rubber_decoupled")).material
    assert made.law == compose("material=rubber_decoupled").material.law


def test_the_scene_gives_the_condition_back(tmp_path: Path) -> None:
    """Seen by the photo's camera, in a picture of its shape, the grips are where the file has them."""
    more = ("camera.background=photo", "camera.width=480", "camera.height=368")
    given = pulled(15.0, 40.0, 50.0, E=2e3, nu=0.2, onset=1.8, crit=2.5, fps=50)
    made = staged(scene(tmp_path, given, *more))
    back = conditioning.of_scene(made)
    assert (back.E, back.nu, back.onset, back.crit, back.fps) == (2e3, 0.2, 1.8, 2.5, 50)
    left, top, wide, high = outline(made.asset).frame(480, 368)
    grips = np.reshape(back.grips, (2, 2)) * (wide, high) + (left, top)
    shift = np.array(centred(made)) * (240, 180)
    assert grips == pytest.approx(np.reshape(given.grips, (2, 2)) * (240, 180) + shift, abs=0.01)
    assert np.reshape(back.velocity, (2, 2)) * (wide, high) == pytest.approx(
        np.reshape(given.velocity, (2, 2)) * (240, 180), abs=0.01
    )


def test_a_staged_scene_is_left_as_it_is(tmp_path: Path) -> None:
    once = staged(scene(tmp_path, pulled(0, 33, 44), "camera.background=photo"))
    assert once.condition == ""
    assert len(once.camera.matrix) == 16
    assert staged(once) == once
    plain = compose()
    assert staged(plain) is plain


def test_the_mask_counts_by_its_content_and_the_cutout_by_its_name(tmp_path: Path) -> None:
    from PIL import Image

    ids = {scene_id(scene(tmp_path)), scene_id(compose("asset=image", f"asset.path={tmp_path / 'loaf.png'}"))}
    for value in (0, 255):
        Image.fromarray(np.full((18, 24), value, np.uint8)).save(tmp_path / "m.png")
        given = ("asset=image", f"asset.path={tmp_path / 'loaf.png'}", f"asset.mask={tmp_path / 'm.png'}")
        ids.add(scene_id(compose(*given)))
    assert len(ids) == 4


def test_grips_off_the_middle_are_moved_with_a_word(tmp_path: Path) -> None:
    given = pulled(0, 33, 44)
    off = replace(given, grips=[x + 0.05 for x in given.grips])
    with pytest.warns(UserWarning, match=r"condition.grips: their middle is 1\d\.\d% of the object's size away"):
        made = staged(scene(tmp_path, off))
    assert made.loading.offset == pytest.approx(33 * 0.6 / 132, rel=0.02)


def test_grips_that_move_unlike_are_told(tmp_path: Path) -> None:
    given = pulled(0, 33, 44)
    one = replace(given, velocity=[0, 0, *given.velocity[2:]])
    with pytest.warns(UserWarning, match=r"condition.velocity: the simulator pulls both grips equally fast.*0.1 m/s"):
        staged(scene(tmp_path, one))


@pytest.mark.parametrize(("given", "message"), [
    (replace(pulled(0, 33, 44), velocity=[0.1, 0, -0.1, 0]), "condition.velocity=.*does not part the grips"),
    (replace(pulled(0, 33, 44), grips=[0.5, 0.5, 0.5, 0.5]), "condition.grips=.*lie on each other"),
    (pulled(0, 3, 44), "leaves no material between grips"),
])  # fmt: skip
def test_pulls_that_are_none_are_refused(given: Condition, message: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=message):
        staged(scene(tmp_path, given))


@pytest.mark.parametrize(("overrides", "message"), [
    (("condition=pull.json",), "condition=pull.json needs a photo, but asset.kind=builtin: set asset=image"),
    (("camera.background=photo",), "camera.background=photo needs a photo, but asset.kind=builtin"),
    (("asset.mask=m.png",), "asset.mask has no effect here, since only photos have it"),
    (("asset=image", "asset.path=a.png", "condition=p.json", "material.E=3e3"), "material.E has no effect here, since "
                                                                               "the condition file sets it"),
    (("asset=image", "asset.path=a.png", "camera.fov_deg=30"), "camera.fov_deg has no effect here"),
    (("asset=image",), "asset.path is empty but asset.kind=image"),
    (("asset.path=cake.jpg",), "asset=image for a photo"),
])  # fmt: skip
def test_fields_that_do_not_go_together_are_named(overrides: tuple[str, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        compose(*overrides)
