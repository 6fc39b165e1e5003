"""Bad input to `python -m fracgen.evaluate`: each clip is named with its reason and counted, the others are scored."""

import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from fracgen import evaluate as command
from fracgen.evaluation import job, load
from fracgen.evaluation.weights import MissingWeightsError
from fracgen.metrics import NEEDED
from fracsim import registry
from fracsim.scene.program import Program
from tests.metrics.folders import METRIC, config, film, generated, grey, truth

EVALUATE: Program[Any] = command.EVALUATE


def reasons(done: job.Done) -> dict[str, str]:
    return {fault.clip: fault.reason for fault in done.faults}


def scored(done: job.Done) -> int:
    entry = done.document["metrics"].get("brightness")
    return int(entry["n"]) if entry else 0


@pytest.fixture
def films(tmp_path: Path) -> Path:
    """A good pair of videos, and good true clips for four bad ones."""
    for name in ("good", "short", "small", "broken", "empty"):
        film(tmp_path / "gt" / f"{name}.mkv", grey(100))
    film(tmp_path / "pred" / "good.mkv", grey(110))
    return tmp_path


def test_bad_videos_are_named_and_the_others_are_scored(films: Path) -> None:
    film(films / "pred" / "short.mkv", grey(110, frames=4))
    film(films / "pred" / "small.mkv", grey(110, width=40))
    film(films / "pred" / "alone.mkv", grey(110))
    film(films / "pred" / "two.mkv", grey(110))
    shutil.copy(films / "pred" / "two.mkv", films / "pred" / "two.mp4")
    (films / "pred" / "broken.mp4").write_bytes(os.urandom(5000))
    (films / "pred" / "empty.webm").touch()
    done = job.run(config(films))
    why = reasons(done)
    assert scored(done) == 1
    assert set(why) == {"short", "small", "alone", "two", "broken", "empty"}
    assert "it has 4 frames, and its true clip 6: say by frame_select" in why["short"]
    assert why["small"] == "it has 40 x 32 px, and its true clip 48 x 32: the shapes differ; crop one of them"
    assert "has no clip for it" in why["alone"]
    assert why["two"] == "several files have this name: two.mkv, two.mp4"
    assert "broken.mp4 cannot be read as a video" in why["broken"]
    assert "empty.webm" in why["empty"]
    named = {fault["clip"]: fault for fault in json.loads((films / "out/metrics.json").read_text())["faults"]}
    assert named["short"]["reason"] == why["short"]
    assert any(line.startswith("1 clip(s), as short: it has 4 frames") for line in done.told)


def test_bad_samples_are_named(tmp_path: Path) -> None:
    """One cut short, one with other frames, one of another rate, one whose true clip is not there, one unfinished."""
    there = [truth(tmp_path / "gt", speed=float(k + 1)) for k in range(4)]
    generated(tmp_path / "pred", there[0])
    cut = generated(tmp_path / "pred", there[1], look=8)
    (cut / "rgb.mkv").write_bytes((cut / "rgb.mkv").read_bytes()[:500])
    long = generated(tmp_path / "pred", there[2], look=9, frames=8)
    fast = generated(tmp_path / "pred", there[3], look=10, fps=50)
    lost = generated(tmp_path / "pred", tmp_path / "gone", look=11)
    (tmp_path / "pred" / "0123456789ab.incomplete").mkdir()
    done = job.run(config(tmp_path))
    why = reasons(done)
    assert scored(done) == 1
    assert "python -m fracsim.dataset verify" in why[cut.name]
    assert "it has 8 frames, and its true clip only 6" in why[long.name]
    assert "alignment=time" in why[fast.name]
    assert "has no clip for it" in why[lost.name]
    assert "not finished" in why["0123456789ab.incomplete"]


def test_a_map_that_some_clips_lack_is_a_fault_of_those(tmp_path: Path) -> None:
    there = [truth(tmp_path / "gt", speed=float(k + 1)) for k in range(2)]
    generated(tmp_path / "pred", there[0])
    bare = generated(tmp_path / "pred", there[1], maps=("flow",))
    done = job.run(config(tmp_path, metric={"brightness": {"map": "damage"}}))
    assert scored(done) == 1
    assert reasons(done) == {bare.name: f"{bare.name} has no damage; it has rgb, flow"}
    assert done.faults[0].metric == "brightness"


def test_a_map_that_all_lack_is_no_fault_but_the_metric_is_missing(films: Path) -> None:
    done = job.run(config(films, metric={"brightness": {"map": "damage"}}))
    assert done.faults == []
    assert done.document["metrics"] == {}
    assert "no clip has what it needs: good has no damage; it has rgb" in done.document["missing"]["brightness"]
    assert "brightness: missing, no clip has" in done.table


def test_values_that_are_not_finite_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    there = truth(tmp_path / "gt")
    made = generated(tmp_path / "pred", there)
    raw = load._Opened.raw

    def spoiled(self: Any, stream: str, numbers: Any) -> Any:
        values = raw(self, stream, numbers)
        if self.source.name == made.name:
            values[2, 3, 4] = np.nan
        return values

    monkeypatch.setattr(load._Opened, "raw", spoiled)
    done = job.run(config(tmp_path, metric={"brightness": {"map": "stress"}}))
    assert reasons(done) == {made.name: f"stress of {made.name} has values that are not finite"}


def test_undefined_values_are_counted_and_left_out(films: Path) -> None:
    """The metric knows no difference of a black clip."""
    film(films / "pred" / "short.mkv", grey(0))
    done = job.run(config(films))
    entry = done.document["metrics"]["brightness"]
    assert (entry["n"], entry["undefined"]) == (2, {"difference": 1})
    assert entry["results"]["difference"]["value"] * 255 == pytest.approx(10)
    assert (films / "out/per_clip.csv").read_text().splitlines()[-1].endswith(",")


def test_missing_weights_are_a_reason_and_the_rest_is_computed(films: Path) -> None:
    other = films / "shine.py"
    other.write_text(Path(METRIC).read_text())
    cfg = {"outside": [METRIC, str(other)], "metric": {"shine": {"weights": "/nowhere/lamp.pt"}}}
    done = job.run(config(films, **cfg))
    assert scored(done) == 1
    assert done.document["missing"] == {
        "shine": "the lamp (1 MB) was not found: set metric.brightness.weights=/nowhere/lamp.pt"
    }
    assert "shine" not in done.document["metrics"]
    with pytest.raises(MissingWeightsError, match="shine: the lamp"):
        job.run(config(films, **cfg, missing_weights="error"))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pred": ""}, "pred= is empty: give a folder"),
        ({"pred": "nowhere"}, "pred=nowhere is not a folder"),
        ({"gt": "nowhere"}, "gt=nowhere is not a folder"),
        ({"outside": []}, r"metric=\[\] holds no metric"),
        ({"outside": ["nowhere.py"]}, "outside=nowhere.py is not a file"),
        ({"metric": {"brightness": {"gian": 1}}}, "metric.brightness.gian=1 is not a field of a metric: did you mean "
                                                  "metric.brightness.gain"),
        ({"metric": {"brightness": {"gain": -1}}}, "metric.brightness.gain=-1 is not allowed"),
        ({"metric": {"brightness": {"gain": "much"}}}, "metric.brightness.gain=much is not allowed: it must be a numb"),
        ({"metric": {"shine": {}}}, "metric=shine is not known: choose one of"),
    ],
)  # fmt: skip
def test_a_configuration_that_cannot_be_used_is_one_clear_error(
    films: Path, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        job.run(config(films, **changes))


def test_an_empty_folder_is_an_error(films: Path) -> None:
    (films / "none").mkdir()
    with pytest.raises(ValueError, match="holds neither finished samples nor videos"):
        job.run(config(films, pred=str(films / "none")))


@pytest.fixture
def line(films: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run the command in this process; gives its exit status."""

    def call(*arguments: str) -> int:
        asked = [f"pred={films / 'pred'}", f"gt={films / 'gt'}", "metric=[]", f"outside=[{METRIC}]", "controls=[]"]
        monkeypatch.setattr(sys, "argv", ["evaluate", *asked, "plots=false", "resamples=0", *arguments])
        try:
            command.main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    return call


def test_strict_fails_after_the_others_were_scored(
    line: Callable[..., int], films: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert line("strict=true") == 0
    film(films / "pred" / "short.mkv", grey(110, frames=4))
    assert line() == 0
    assert "1 clip(s), as short: it has 4 frames" in capsys.readouterr().err
    assert line("strict=true") == 2
    out = capsys.readouterr()
    assert "strict=true: 1 clip(s) could not be scored" in out.err
    assert "| brightness.difference ↓ | 0.03922 | 1 |" in out.out


def test_nothing_to_score_is_an_error(line: Callable[..., int], capsys: pytest.CaptureFixture[str]) -> None:
    assert line("+metric.brightness.map=damage") == 2
    assert "nothing could be scored" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["metric=[heat]"], "metric=heat is not known: choose one of dpa, fvd, "),
        (["metric=[psnr]", "metric.sac.tracker=lk"], r"sac is not chosen; choose it by metric=\[psnr,sac\]"),
        (["metric=[sac]", "metric.sac.trakcer=lk"], r"metric.sac has the fields tracker, .*did you mean tracker\?"),
        (["metric.sacc.k=3"], r"metric has no sacc, only .*did you mean sac\?"),
        (["metric=[./mine.py]"], r"outside=\[./mine.py\]"),
        (["contols=[]"], "did you mean controls"),
        (["alignment=later"], "alignment=later is not allowed: it must be one of select, time, spread"),
    ],
)
def test_errors_of_the_command_line_name_the_way_out(overrides: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EVALUATE.compose(*overrides)


METRICS = EVALUATE.groups["metric"]


@pytest.mark.parametrize("name", METRICS)
def test_the_file_of_a_metric_holds_its_defaults(name: str) -> None:
    """And says in a comment what the metric is."""
    nodes = EVALUATE.compose(f"metric=[{name}]").metric
    module = registry.load("fracgen.metrics", name, "metric")
    assert list(nodes) == [name]
    assert module.Settings(**nodes[name]) == module.Settings()
    comments = (EVALUATE.folder / "metric" / f"{name}.yaml").read_text().splitlines()
    assert comments[0] == f"# @package metric.{name}"
    assert comments[1].startswith("# ")


def test_every_metric_has_a_file_and_all_but_vmaf_are_measured_by_default() -> None:
    assert set(METRICS) == set(registry.names("fracgen.metrics"))
    assert set(METRICS) - set(EVALUATE.compose().metric) <= {"vmaf"}
    assert NEEDED == ("Settings", "build")


def test_a_video_of_pictures_with_a_palette_is_read(tmp_path: Path) -> None:
    for side in ("pred", "gt"):
        (tmp_path / side).mkdir()
        frames = [Image.fromarray(grey(k, 1)[0]).convert("P") for k in (10, 200)]
        frames[0].save(tmp_path / side / "x.gif", save_all=True, append_images=frames[1:])
    assert scored(job.run(config(tmp_path))) == 1
