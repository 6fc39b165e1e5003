"""What the page says of a condition: presets, numbers and force of the network, files, the album of a folder."""

import io
import json
from dataclasses import asdict, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from fastapi.testclient import TestClient
from PIL import Image, ImageSequence

from fracgen import conditioning
from fracgen.annotation import album, presets, preview, schema
from fracgen.annotation.preview import Size
from fracsim.scene import condition as condition_file
from fracsim.scene.condition import Condition
from fracsim.scene.program import compose
from tests.annotate.photos import CENTRE, photo
from tests.annotate.serving import Tab, served, text

SCHEMA = Path(__file__).parents[2] / "docs" / "condition.schema.json"
PULL = Condition(E=2e4, nu=0.45, category="high_stretch", onset=2.6, crit=3.0, grips=[0.3, 0.4, 0.7, 0.6],
                 velocity=[-0.2, -0.1, 0.25, 0.1], fps=50.0, caption="A duck tears.")  # fmt: skip


def test_presets_are_the_values_of_conf() -> None:
    found = {preset["name"]: preset for preset in presets.presets()}
    for name, material, fracture in presets.PRESETS:
        scene = compose(f"material={material}", f"fracture={fracture}")
        assert found[name]["E"] == scene.material.E
        assert found[name]["nu"] == scene.material.nu
        assert (found[name]["onset"], found[name]["crit"]) == (scene.fracture.onset, scene.fracture.crit)
        Condition(**{key: value for key, value in found[name].items() if key != "name"})
    assert {preset["category"] for preset in found.values()} == {"low_stretch", "high_stretch"}


def test_ranges_are_those_of_the_network_and_of_a_condition() -> None:
    """The paper's: E from 1e3 to 1e9 Pa, nu from 0.1 to 0.5, stretches from 1 to 10."""
    found = {name: (r["low"], r["high"]) for name, r in presets.ranges().items()}
    assert found == {"E": (1e3, 1e9), "nu": (0.1, 0.5), "onset": (1, 10), "crit": (1, 10)}
    assert presets.ranges()["E"]["least"] == 1e2


@pytest.mark.parametrize(("changes", "outside"), [
    ({}, []), ({"E": 5e9}, ["E"]), ({"nu": 0.05}, ["nu"]), ({"E": 200.0, "nu": 0.0}, ["E", "nu"]),
    ({"E": 1e9, "nu": 0.1, "onset": 1.0, "crit": 10.0}, []),
])  # fmt: skip
def test_numbers_are_those_of_the_network_and_what_it_does_not_know_is_named(
    changes: dict[str, float], outside: list[str]
) -> None:
    condition = Condition(**changes)  # type: ignore[arg-type]
    found = preview.numbers(condition)
    assert found["outside"] == outside
    assert list(found["numbers"].values()) == conditioning.scalars(condition, "clamp").tolist()


@pytest.mark.parametrize(("fit", "photo_size"), [("fit", (832, 480)), ("fit", (400, 400)), ("crop", (300, 500))])
def test_the_preview_is_the_force_video_of_training_in_small(fit: str, photo_size: tuple[int, int]) -> None:
    """Averaged over blocks of 2 x 2 pixels the blobs of training are those of half the size, but for the width of the
    blocks: below 1 % at a standard deviation of 20 px. What differs in time is the choice of frames."""
    size = Size()
    corner_left, corner_top, width, height = preview.box(photo_size, size, fit)
    moved = Condition(grips=[(g - c) / s for g, c, s in zip(PULL.grips, [corner_left, corner_top] * 2,
                                                            [width, height] * 2, strict=True)],
                      velocity=[v / s for v, s in zip(PULL.velocity, [width, height] * 2, strict=True)],
                      fps=PULL.fps)  # fmt: skip
    whole = conditioning.blobs(moved.paths(size.frames, size.width, size.height), size.width, size.height)[..., 0]
    small = whole.reshape(81, 240, 2, 416, 2).mean(axis=(2, 4))
    found = preview.force(PULL, photo_size, size, fit) / 255
    assert found.shape == (21, 240, 416)
    assert np.abs(found - small[::4]).max() < 0.01 + 0.5 / 255


def test_a_clip_has_the_frame_rate_of_its_run() -> None:
    """As `fracgen.sample` has it, whatever rate the condition file names."""
    found = preview.force(PULL, (64, 48), Size(9, 48, 64, fps=100.0), "fit")
    assert np.array_equal(found, preview.force(replace(PULL, fps=100.0), (64, 48), Size(9, 48, 64), "fit"))
    assert not np.array_equal(found, preview.force(PULL, (64, 48), Size(9, 48, 64), "fit"))


def test_the_animation_holds_these_frames() -> None:
    frames = preview.force(PULL, (64, 48), Size(9, 48, 64), "fit")
    shown = Image.open(io.BytesIO(preview.animation(frames)))
    assert np.array_equal(np.stack([np.asarray(f.convert("L")) for f in ImageSequence.Iterator(shown)]), frames)


def test_the_committed_schema_is_that_of_the_dataclass() -> None:
    """`python -m fracgen.annotation.schema docs/condition.schema.json` writes it again."""
    assert SCHEMA.read_text() == schema.text()


def test_the_schema_admits_what_a_condition_admits() -> None:
    checker = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
    checker.check_schema(checker.schema)
    for value in (PULL, Condition()):
        assert checker.is_valid(json.loads(condition_file.text(value)))
    whole = asdict(PULL)
    less = {name: value for name, value in whole.items() if name not in ("fps", "caption")}
    assert checker.is_valid(less)
    bad = [{"E": 10.0}, {"E": "soft"}, {"nu": 0.6}, {"category": "brittle"}, {"grips": [1, 2, 3]}, {"crit": 1.0},
           {"speed": 3}, {"fps": 0}]  # fmt: skip
    for change in bad:
        assert not checker.is_valid({**whole, **change}), change
        with pytest.raises(ValueError, match="condition"):
            condition_file.parse({**whole, **change}, "condition")
    del less["nu"]
    assert not checker.is_valid(less)


def test_export_and_import_keep_every_field() -> None:
    with served() as client:
        tab = Tab(client)
        file = tab.get("condition.json", condition=condition_file.text(PULL))
        assert "attachment" in file.headers["content-disposition"]
        assert tab.request("POST", "condition", content=file.content).json() == asdict(PULL)


@pytest.mark.parametrize("content", ["", "{", "[" * 50_000, "null", "[1]", text(E=1), text(crit=1.2), text(nu="x"),
                                     text(speed=1), '{"E": NaN}', text(E=1e400)])  # fmt: skip
def test_a_bad_condition_is_named_and_nothing_happens(content: str) -> None:
    with served() as client:
        tab = Tab(client)
        answers = [tab.request("POST", "condition", content=content)]
        if len(content) < 1000:  # an address is no longer than that
            answers.append(tab.get("numbers", condition=content))
        for answer in answers:
            assert answer.status_code == 422
            assert answer.json()["error"].startswith("condition")


def test_a_folder_is_paged_through_and_saving_writes_one_file_beside_an_image(tmp_path: Path) -> None:
    photo(tmp_path / "b.png", 64, 48), photo(tmp_path / "a.png", 64, 48)
    (tmp_path / "notes.txt").write_text("no image")
    with served(album=album.opened(str(tmp_path))) as client:
        tab = Tab(client)
        assert client.get("/setup").json()["images"] == [{"name": "a.png", "saved": False},
                                                         {"name": "b.png", "saved": False}]  # fmt: skip
        assert tab.request("POST", "open/1").json()["condition"] is None
        assert tab.request("PUT", "saved", content=condition_file.text(PULL)).json() == {"name": "b.json"}
        assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "b.json", "b.png", "notes.txt"]
        assert condition_file.load(tmp_path / "b.json") == PULL
        assert tab.request("POST", "open/1").json()["condition"] == asdict(PULL)
        assert tab.request("POST", "open/0").json()["condition"] is None
        for index in (2, -1, 10**30):
            assert tab.request("POST", f"open/{index}").status_code == 404
        assert tab.request("POST", "open/..%2f..%2fetc%2fpasswd").status_code in (404, 422)


def test_a_cut_out_beside_an_image_is_used_and_is_no_image_itself(tmp_path: Path) -> None:
    photo(tmp_path / "a.png")
    mask = Image.new("L", (320, 240))
    mask.paste(255, (80, 60, 240, 120))
    mask.save(tmp_path / "a.mask.png")
    with served(album=album.opened(str(tmp_path))) as client:
        tab = Tab(client)
        assert [image["name"] for image in client.get("/setup").json()["images"]] == ["a.png"]
        assert tab.request("POST", "open/0").json()["object"]["centre"] == pytest.approx([0.5, 0.375], abs=0.005)
        assert tab.request("POST", "mask/again").json()["object"]["centre"] == pytest.approx(CENTRE, abs=0.01)


def test_a_broken_image_of_a_folder_does_not_stop_the_others(tmp_path: Path) -> None:
    photo(tmp_path / "b.png", 64, 48)
    (tmp_path / "a.png").write_bytes(b"broken")
    with served(album=album.opened(str(tmp_path))) as client:
        tab = Tab(client)
        assert tab.request("POST", "open/0").status_code == 422
        assert tab.request("POST", "open/1").status_code == 200
        (tmp_path / "b.png").unlink()
        assert tab.request("POST", "open/1").json()["error"].startswith("b.png cannot be read")


def test_a_file_that_is_no_condition_is_never_overwritten(tmp_path: Path) -> None:
    photo(tmp_path / "a.png", 64, 48)
    (tmp_path / "a.json").write_text('{"mine": 1}')
    with served(album=album.opened(str(tmp_path / "a.png"))) as client:
        tab = Tab(client)
        opened = tab.request("POST", "open/0").json()
        assert opened["condition"] is None
        assert "a.json cannot be used" in opened["note"]
        answer = tab.request("PUT", "saved", content=condition_file.text(PULL))
        assert answer.status_code == 422
        assert "Move that file away" in answer.json()["error"]
    assert (tmp_path / "a.json").read_text() == '{"mine": 1}'


def test_an_upload_is_not_saved_anywhere(tmp_path: Path) -> None:
    with served() as client:
        tab = Tab(client)
        tab.upload(photo(tmp_path / "a.png", 64, 48))
        assert tab.request("PUT", "saved", content=condition_file.text(PULL)).status_code == 422


@pytest.mark.parametrize(("files", "given", "message"), [
    ([], "", "holds no image"), ([], "nowhere", "neither an image nor a folder"),
    (["a.png", "a.jpg"], "", r"a\.jpg and a\.png would share the condition file a\.json"),
])  # fmt: skip
def test_a_folder_that_cannot_be_paged_through_is_refused(
    files: list[str], given: str, message: str, tmp_path: Path
) -> None:
    for name in files:
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match=message):
        album.opened(str(tmp_path / given))


def test_no_folder_is_no_album() -> None:
    assert album.opened("").images == ()


def test_the_page_names_what_it_is_made_of() -> None:
    with served() as client:
        assert isinstance(client, TestClient)
        setup = client.get("/setup").json()
        assert setup["size"] == {"frames": 81, "height": 480, "width": 832, "fps": 0}
        assert "--run" in setup["no_generator"]
