"""The weights that lie in docs generate what docs/laptop.md says."""

import statistics
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import pytest

import fracsim.sample
from fracgen.laptop import clips
from fracgen.sample import SAMPLE
from fracgen.sampling import job

DOCS = Path(__file__).parents[2] / "docs"
WEIGHTS = DOCS / "laptop_weights"


def generated(*overrides: str) -> Sequence[Path]:
    vae = ["vae=tiny", f"vae.path={WEIGHTS / 'vae'}", "encoders=tiny"]
    return job.run(SAMPLE.compose(f"run={WEIGHTS / 'generator'}", *vae, "sampler=preview", *overrides))


def test_the_weights_in_docs_generate_a_clip(tmp_path: Path) -> None:
    photo = DOCS / "photos/croissant.jpg"
    (folder,) = generated(f"image={photo}", f"condition={photo.with_suffix('.json')}", f"output.folder={tmp_path}")
    clip = fracsim.sample.read(folder)
    assert clip.rgb.shape == (21, 96, 96, 3)
    assert set(clip.meta["maps"]) == {"flow", "strain", "stress", "damage"}
    assert clip.read("damage").std() > 0


@pytest.fixture(name="pulls", scope="module")
def pulls_fixture(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, object]]:
    """A loaf pulled along two axes with early and late thresholds, as it was not in training; true and generated."""
    folder = tmp_path_factory.mktemp("pulls")
    words = ["+sweep=laptop", "asset=bread", "draw=-1", "loading.axis_deg=0,45", "fracture=bread,rubber_late",
             "loading.speed=0.9", "loading.offset=0.15", f"output.folder={folder / 'true'}"]  # fmt: skip
    subprocess.run([sys.executable, "-m", "fracsim", *words], check=True, capture_output=True)
    generated(f"data={folder / 'true'}", "split=all", "batch=4", f"output.folder={folder / 'made'}")
    return clips.pulls(str(folder / "true"), str(folder / "made"))


def test_generated_pieces_part_along_the_axis_of_the_pull(pulls: list[dict[str, object]]) -> None:
    """Chance is 45 degrees."""
    off = [clips.between(float(row["made_axis"]), float(row["true_axis"])) for row in pulls]
    assert statistics.mean(off) < 15


def test_generated_clips_tear_earlier_with_early_thresholds(pulls: list[dict[str, object]]) -> None:
    torn: dict[object, dict[float, int]] = defaultdict(dict)
    for row in pulls:
        torn[row["axis"]][float(row["crit"])] = int(row["made_torn"])
    assert len(torn) == 2
    assert all(frames[2.3] < frames[3.3] for frames in torn.values())
