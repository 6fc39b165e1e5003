"""What the generator is told: numbers at the ends of the ranges, blobs where the grips are, files, channels."""

import json
import math
import warnings
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from fracgen import conditioning
from fracsim.camera import project, view_of
from fracsim.scene import condition as condition_file
from fracsim.scene.condition import Condition
from fracsim.scene.vocab import Asset, Camera, Capture, Fracture, Loading, Material, Scene

LOW = {"E": 1e3, "nu": 0.1, "onset": 1.0, "crit": 1.0 + 1e-9, "category": "high_stretch"}
HIGH = {"E": 1e9, "nu": 0.5, "onset": 10.0 - 1e-9, "crit": 10.0, "category": "low_stretch"}
SIGMA = 1 / 24


def conditions() -> st.SearchStrategy[Condition]:
    """Conditions of all sorts, without subnormal numbers: some libraries make the processor round them to zero."""
    fours = st.lists(st.floats(-2, 3, allow_subnormal=False), min_size=4, max_size=4)
    stretches = st.tuples(st.floats(1, 9.9), st.floats(0.01, 1)).map(lambda s: (s[0], min(10.0, s[0] + s[1])))
    return st.builds(
        lambda stretch, **rest: Condition(onset=stretch[0], crit=stretch[1], **rest),
        stretches.filter(lambda s: s[1] > s[0]), E=st.floats(1e2, 1e10), nu=st.floats(0, 0.5, allow_subnormal=False),
        category=st.sampled_from(["low_stretch", "high_stretch"]), grips=fours, velocity=fours,
        fps=st.floats(1, 1e5), caption=st.text(max_size=20),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "low", "high"), [("E", 1e3, 1e9), ("nu", 0.1, 0.5), ("onset", 1, 10), ("crit", 1, 10)]
)
def test_the_ranges_of_the_paper_become_minus_1_to_1(name: str, low: float, high: float) -> None:
    index = conditioning.SCALARS.index(name)
    assert getattr(Condition(**LOW), name) == pytest.approx(low)  # type: ignore[arg-type]
    assert getattr(Condition(**HIGH), name) == pytest.approx(high)  # type: ignore[arg-type]
    assert conditioning.scalars(Condition(**LOW))[index] == pytest.approx(-1)  # type: ignore[arg-type]
    assert conditioning.scalars(Condition(**HIGH))[index] == pytest.approx(1)  # type: ignore[arg-type]


def test_numbers_have_the_order_of_the_channels() -> None:
    """log10 of E: 1e6 Pa is the middle; the category is 1 and -1."""
    middle = Condition(E=1e6, nu=0.3, category="low_stretch", onset=3.25, crit=7.75)
    assert conditioning.SCALARS == ("E", "nu", "low", "high", "onset", "crit")
    assert conditioning.scalars(middle).tolist() == pytest.approx([0, 0, 1, -1, -0.5, 0.5], abs=1e-7)
    other = conditioning.scalars(replace(middle, category="high_stretch"))
    assert other.tolist() == pytest.approx([0, 0, -1, 1, -0.5, 0.5], abs=1e-7)


@given(conditions())
def test_physical_inverts_scalars(condition: Condition) -> None:
    """Inside the paper's ranges; float32 has 24 bits, so a stretch is good to 9 / 2^24, E to log(10) 6 / 2^24 of it."""
    inside = replace(condition, E=min(max(condition.E, 1e3), 1e9), nu=max(condition.nu, 0.1))
    back = conditioning.physical(conditioning.scalars(inside).tolist())
    assert back["category"] == inside.category
    assert back["E"] == pytest.approx(inside.E, rel=1e-6)
    for name in ("nu", "onset", "crit"):
        assert back[name] == pytest.approx(getattr(inside, name), abs=6e-7)


@pytest.mark.parametrize(("name", "value", "limit", "words"), [
    ("E", 5e9, 1.0, "1e3 to 1e9 Pa"), ("E", 200.0, -1.0, "1e3 to 1e9 Pa"), ("nu", 0.05, -1.0, r"0\.1 to 0\.5"),
])  # fmt: skip
def test_numbers_outside_are_clamped_warned_of_or_refused(name: str, value: float, limit: float, words: str) -> None:
    condition = Condition(**{name: value})
    index = conditioning.SCALARS.index(name)
    message = rf"condition\.{name}=.* is outside {words}"
    with pytest.warns(UserWarning, match=message):
        assert conditioning.scalars(condition, "warn")[index] == limit
    with pytest.raises(ValueError, match=message):
        conditioning.scalars(condition, "fail")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert conditioning.scalars(condition, "clamp")[index] == limit


@pytest.mark.parametrize(("x", "y"), [(100.0, 60.0), (87.3, 71.9), (64.5, 64.5)])
def test_a_blob_has_its_centre_of_mass_at_the_grip_and_a_24th_of_the_height_as_width(x: float, y: float) -> None:
    """Pixel centres lie at half numbers; sigma is 5 px and the frame ends 9 sigma away: no tail is cut."""
    width, height = 192, 120
    grey = conditioning.blobs(np.array([[[x, y]]]), width, height)[0, ..., 0].astype(np.float64)
    columns, rows = np.arange(width) + 0.5, np.arange(height) + 0.5
    total = grey.sum()
    mean_x, mean_y = (grey.sum(0) @ columns) / total, (grey.sum(1) @ rows) / total
    assert (mean_x, mean_y) == pytest.approx((x, y), abs=0.01)
    assert math.sqrt(grey.sum(0) @ (columns - mean_x) ** 2 / total) == pytest.approx(SIGMA * height, rel=1e-3)
    assert math.sqrt(grey.sum(1) @ (rows - mean_y) ** 2 / total) == pytest.approx(SIGMA * height, rel=1e-3)


def test_a_blob_on_a_pixel_centre_is_1_there_and_falls_as_a_gaussian() -> None:
    video = conditioning.blobs(np.array([[[32.5, 24.5]]]), 64, 48)
    assert video.shape == (1, 48, 64, 3)
    assert video.dtype == np.float32
    assert video[0, 24, 32].tolist() == [1, 1, 1]
    assert video[0, 24, 34, 0] == pytest.approx(math.exp(-0.5))  # sigma is 2 px
    assert np.array_equal(video[..., 0], video[..., 1])
    assert np.array_equal(video[..., 0], video[..., 2])


def test_blobs_that_overlap_add_up_to_at_most_1() -> None:
    near = np.array([[[30.5, 24.5], [32.5, 24.5]]])
    one, other = (conditioning.blobs(near[:, k : k + 1], 64, 48) for k in range(2))
    both = conditioning.blobs(near, 64, 48)
    assert np.allclose(both, np.minimum(one + other, 1), atol=1e-6)
    assert both.max() == 1
    assert (one + other).max() > 1.5


def test_a_grip_outside_the_picture_leaves_it_black_and_at_its_edge_half_a_blob() -> None:
    outside = np.array([[[-40.0, 24.0], [32.0, 90.0]]])
    assert conditioning.blobs(outside, 64, 48).max() < 1e-6
    edge = conditioning.blobs(np.array([[[0.0, 24.0]]]), 64, 48)[..., 0].sum()
    whole = conditioning.blobs(np.array([[[32.0, 24.0]]]), 64, 48)[..., 0].sum()
    assert edge == pytest.approx(whole / 2, rel=1e-4)


def test_paths_of_a_condition_are_straight_and_in_seconds() -> None:
    paths = Condition(grips=[0.25, 0.5, 0.75, 0.5], velocity=[-1, 0, 1, 0.5], fps=50).paths(3, 200, 100)
    assert paths.shape == (3, 2, 2)
    assert paths[0].tolist() == [[50, 50], [150, 50]]
    assert np.allclose(paths[2], [[50 - 200 * 2 / 50, 50], [150 + 200 * 2 / 50, 50 + 50 * 2 / 50]])


def scene(axis: float = 0.0, speed: float = 0.6, **camera: Any) -> Scene:
    return Scene(camera=Camera(width=256, height=192, **camera), loading=Loading(axis_deg=axis, speed=speed),
                 capture=Capture(frames=81, fps=100.0))  # fmt: skip


@pytest.mark.parametrize("axis", [0.0, 30.0, 90.0, 135.0])
def test_seen_from_the_front_the_grips_move_by_v_t(axis: float) -> None:
    """A metre in the plane of the axis has the same number of pixels everywhere; image y points down."""
    s = scene(axis)
    view = view_of(s)
    metre = view.fx / float(view.eye[2] - 1)
    reach = s.loading.offset + s.loading.speed * np.arange(81) / 100
    u = np.array([math.cos(math.radians(axis)), -math.sin(math.radians(axis))])
    expected = np.stack([[128, 96] - metre * reach[:, None] * u, [128, 96] + metre * reach[:, None] * u], axis=1)
    assert np.allclose(conditioning.scene_paths(s, 81), expected, atol=1e-9)
    assert np.allclose(conditioning.of_scene(s).paths(81, 256, 192), expected, atol=1e-9)


@pytest.mark.parametrize("axis", [0.0, 30.0, 90.0])
@pytest.mark.parametrize(("azimuth", "elevation"), [(35.0, 20.0), (60.0, 30.0)])
def test_an_oblique_condition_is_off_by_what_perspective_bends(axis: float, azimuth: float, elevation: float) -> None:
    """With r the ratio of its depths at the ends, a point that moves evenly in space is ahead of, or behind, one that
    moves evenly in the picture by up to |sqrt r - 1| / (sqrt r + 1) of its way; at both ends they agree.

    For the camera of conf/camera/oblique.yaml that is below 6 % of the way.
    """
    s = scene(axis, azimuth_deg=azimuth, elevation_deg=elevation)
    exact, straight = conditioning.scene_paths(s, 81), conditioning.of_scene(s).paths(81, 256, 192)
    assert np.allclose(straight[[0, -1]], exact[[0, -1]], atol=1e-9)
    ends = conditioning.grip_points(s, np.array([0.0, 0.8])).reshape(-1, 3)
    depth = project(view_of(s), ends)[1].reshape(2, 2)
    root = np.sqrt(depth[1] / depth[0])
    way = np.linalg.norm(exact[-1] - exact[0], axis=-1)
    off = np.linalg.norm(straight - exact, axis=-1).max(axis=0)
    assert np.allclose(off, way * np.abs(root - 1) / (root + 1), rtol=2e-3)  # the largest of 81 frames
    if azimuth == 35:
        assert (off < 0.06 * way).all()


def test_a_grip_behind_the_camera_is_refused() -> None:
    near = [1.0, 0, 0, -1, 0, -1.0, 0, 1, 0, 0, -1, 0.9, 0, 0, 0, 1]  # the pinhole is 0.1 m behind the centre
    s = scene(matrix=near, intrinsics=[100.0, 100.0, 128.0, 96.0])
    with pytest.raises(ValueError, match="a grip lies behind the camera"):
        conditioning.of_scene(s)


def test_the_condition_of_a_scene_has_its_material_and_fracture() -> None:
    s = replace(scene(), material=Material(E=2e4, nu=0.45, law="neo_hookean"), fracture=Fracture(onset=2.6, crit=3.3),
                asset=Asset(name="duck"))  # fmt: skip
    made = conditioning.of_scene(s)
    assert (made.E, made.nu, made.onset, made.crit, made.fps) == (2e4, 0.45, 2.6, 3.3, 100.0)
    assert made.category == "high_stretch"


@pytest.mark.parametrize(("kind", "law", "category"), [("bread", "neo_hookean", "low_stretch"),
                                                       ("bar", "neo_hookean", "high_stretch"),
                                                       ("bar", "fixed_corotated", "low_stretch")])  # fmt: skip
def test_the_kind_of_fracture_is_that_of_the_object_or_of_its_law(kind: str, law: str, category: str) -> None:
    s = replace(scene(), asset=Asset(name=kind), material=Material(law=law))
    assert conditioning.of_scene(s).category == category


@given(condition=conditions())
def test_a_condition_file_keeps_every_field(condition: Condition, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("condition") / "condition.json"
    condition_file.save(condition, path)
    assert condition_file.load(path) == condition


def test_frame_rate_and_caption_may_be_left_out_and_whole_numbers_are_numbers(tmp_path: Path) -> None:
    content = {**asdict(Condition()), "E": 6000, "grips": [0, 1, 1, 0]}
    del content["fps"], content["caption"]
    path = tmp_path / "c.json"
    path.write_text(json.dumps(content))
    assert condition_file.load(path) == Condition(grips=[0, 1, 1, 0])


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "missing": ({"nu": None}, r"has \['E', .*a condition has E, nu, category, onset, crit, grips, velocity"),
    "unknown": ({"speed": 3}, r"'speed'\]: a condition has E, nu"),
    "text for a number": ({"E": "soft"}, r"E=soft is not allowed: it must be a number in \[100, 1e10\] Pa"),
    "number for a text": ({"category": 3}, r"category=3 is not allowed: it must be one of low_stretch, high_stretch"),
    "number for a list": ({"grips": 0.5}, r"grips=0\.5 is not allowed: it must be a list"),
    "list for a number": ({"E": [1e3]}, r"E=\[1000\] is not allowed"),
    "text in a list": ({"grips": [0, 0, "a", 0]}, r"grips=\[0,0,a,0\] is not allowed"),
    "flag for a number": ({"nu": True}, r"nu=true is not allowed"),
    "three numbers": ({"velocity": [1, 2, 3]}, r"condition\.velocity=\[1\.0, 2\.0, 3\.0\] must have four numbers"),
    "not a number": ({"nu": math.nan}, r"condition\.nu=nan is not allowed"),
    "infinite": ({"E": math.inf}, r"condition\.E=inf is not allowed"),
    "beyond floats": ({"E": 10**400}, r"int too large"),
    "beyond physics": ({"nu": 0.6}, r"condition\.nu=0\.6 is not allowed: it must be a number in \[0, 0\.5\]"),
    "other category": ({"category": "brittle"}, r"condition\.category=brittle is not allowed"),
    "crit below onset": ({"onset": 3.0, "crit": 2.0}, r"condition\.crit=2\.0 must be greater than condition\.onset=3"),
    "crit at onset": ({"onset": 3.0, "crit": 3.0}, r"condition\.crit=3\.0 must be greater"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_condition_file_is_named_with_its_field(name: str, tmp_path: Path) -> None:
    change, message = BAD[name]
    content = {key: value for key, value in {**asdict(Condition()), **change}.items() if value is not None}
    path = tmp_path / "pull.json"
    path.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"condition=.*pull\.json.*{message}"):
        condition_file.load(path)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", "3", "null", '"E"', "[" * 100_000, "\ud800"])
def test_a_file_that_holds_no_condition_is_named(text: str, tmp_path: Path) -> None:
    path = tmp_path / "pull.json"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(ValueError, match=r"condition=.*pull\.json"):
        condition_file.load(path)
    with pytest.raises(ValueError, match=r"condition=.*nowhere\.json cannot be read"):
        condition_file.load(tmp_path / "nowhere.json")


@pytest.mark.parametrize("streams", [1, 3, 5])
def test_channels_are_force_then_six_numbers_then_zeros(streams: int) -> None:
    """0 to 15 force, 16 E, 17 nu, 18 low, 19 high, 20 onset, 21 crit, 22 to 31 zero; alike beside each map."""
    force, numbers = torch.randn(2, 16, 3, 4, 6), torch.rand(2, 6) + 1
    out = conditioning.channels(force, numbers, streams)
    assert out.shape == (2, 32, 3, 4 * streams, 6)
    for k in range(streams):
        beside = out[..., 4 * k : 4 * k + 4, :]
        assert torch.equal(beside[:, :16], force)
        for index in range(6):
            expected = numbers[:, index, None, None, None].expand(-1, 3, 4, 6)
            assert torch.equal(beside[:, 16 + index], expected)
        assert not beside[:, 22:].any()


def test_rgb_only_leaves_zeros_beside_the_maps() -> None:
    force, numbers = torch.randn(2, 16, 3, 4, 6), torch.rand(2, 6) + 1
    tile = conditioning.channels(force, numbers, 5, "tile")
    alone = conditioning.channels(force, numbers, 5, "rgb_only")
    assert alone.shape == tile.shape
    assert torch.equal(alone[..., :4, :], tile[..., :4, :])
    assert not alone[..., 4:, :].any()


def test_a_gain_multiplies_the_numbers_and_nothing_else() -> None:
    force, numbers = torch.randn(2, 16, 3, 4, 6), torch.rand(2, 6) + 1
    once, twice = (conditioning.channels(force, numbers, 2, gain=gain) for gain in (1.0, 2.0))
    assert torch.equal(twice[:, 16:22], 2 * once[:, 16:22])
    assert torch.equal(twice[:, :16], once[:, :16])
    assert torch.equal(twice[:, 22:], once[:, 22:])


def test_channels_take_the_type_of_the_force() -> None:
    out = conditioning.channels(torch.zeros(1, 16, 1, 2, 2).bfloat16(), torch.full((1, 6), 0.3), 2)
    assert out.dtype == torch.bfloat16
    assert float(out[0, 16, 0, 0, 0]) == pytest.approx(0.3, rel=2**-8)
