"""Pictures of a sample for other programs, and the command that writes and checks samples."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fracsim import compose, sample
from fracsim.run import pipeline
from fracsim.sample.__main__ import main
from fracsim.sample.picture import COLUMN, frames, save
from tests.command import SMALL


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sample of nine frames."""
    folder = tmp_path_factory.mktemp("outputs")
    return pipeline.run(compose("asset=bar", *SMALL, "capture.frames=9", f"output.folder={folder}")).sample().path


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_an_animation_has_every_second_frame_of_the_strip(made: Path, tmp_path: Path, suffix: str) -> None:
    """0, 2, 4, 6, 8, endlessly, at 25 frames a second of the strip; equal frames may be merged, their times add up."""
    clip = sample.read(made)
    path = save(clip, tmp_path / f"tear.{suffix}", width=200)
    with Image.open(path) as image:
        assert image.width == min(200, frames(clip)[0].shape[1])
        total = 0
        for k in range(image.n_frames):
            image.seek(k)
            image.load()
            total += image.info["duration"]
        assert total == 5 * 80
        assert image.info["loop"] == 0


def test_a_png_is_a_column_of_frames(made: Path, tmp_path: Path) -> None:
    clip = sample.read(made)
    h, w, _ = frames(clip)[0].shape
    with Image.open(save(clip, tmp_path / "tear.png", width=w)) as image:
        column = np.asarray(image)
    assert column.shape == (COLUMN * h, w, 3)
    assert np.array_equal(column[:h], frames(clip)[0])
    assert np.array_equal(column[-h:], frames(clip)[-1])


def test_what_cannot_be_shown_is_named(made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ValueError, match=r"tear\.bmp is no picture .* must end in \.png, \.gif, \.webp"):
        save(sample.read(made), tmp_path / "tear.bmp")
    with pytest.raises(ValueError, match="width=0"):
        save(sample.read(made), tmp_path / "tear.png", width=0)
    assert main(["picture", str(tmp_path), "tear.gif"]) == 1
    assert "is not a sample" in capsys.readouterr().err


def test_verify_takes_samples_and_folders_of_them(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What a multirun leaves beside them is no sample, and no fault."""
    (made.parent / "multirun").mkdir()
    for given in ([made], [made.parent], sorted(made.parent.iterdir())):
        assert main(["verify", *map(str, given)]) == 0
        assert capsys.readouterr().out == f"{made}: as it was written\n"
    assert main(["verify", str(made.parent / "multirun")]) == 1
    assert "is not a sample" in capsys.readouterr().out


def test_an_ffmpeg_that_is_none_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(tmp_path / "gone"))
    outcome = pipeline.run(compose("asset=bar", *SMALL, "capture.frames=2", f"output.folder={tmp_path}"))
    assert outcome.status == "failed"
    assert "ffmpeg cannot be started" in outcome.reason
    assert "unset IMAGEIO_FFMPEG_EXE" in outcome.reason
