"""VMAF by the ffmpeg that is there: it falls with blur, and says when it cannot be had."""

import subprocess
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from fracgen.metrics import vmaf
from fracsim.records import Array
from tests.metrics.pixel_clips import noise, pair


def textured(blur: float = 0.0) -> Array:
    """Four equal frames of smooth noise, blurred once more, (4, 64, 64, 3) uint8."""
    smooth = ndimage.gaussian_filter(np.random.default_rng(0).random((64, 64, 3)), (2, 2, 0))
    picture = ndimage.gaussian_filter((smooth - smooth.min()) / np.ptp(smooth), (blur, blur, 0))
    return np.broadcast_to(np.rint(255 * picture).astype(np.uint8), (4, 64, 64, 3))


@pytest.fixture(scope="module")
def metric() -> vmaf.Vmaf:
    try:
        return vmaf.build(vmaf.Settings())
    except ValueError as error:
        pytest.skip(str(error))


def test_equal_clips_have_the_top_and_blur_takes_it_away(metric: vmaf.Vmaf) -> None:
    """The model gives equal frames 95 to 100, and ends at 0."""
    scores = [metric.observe(pair(textured(blur), textured()))["vmaf"] for blur in (0, 1, 2, 4)]
    assert scores[0] > 95
    assert scores == sorted(scores, reverse=True)
    assert scores[-1] < 20


def test_there_is_a_score_a_frame(metric: vmaf.Vmaf) -> None:
    assert metric.scores(textured(1.0), textured()).shape == (4,)


def test_which_clip_is_the_true_one_matters(metric: vmaf.Vmaf) -> None:
    """A sharp picture of a blurred one is no loss."""
    assert metric.scores(textured(), textured(2)).mean() > metric.scores(textured(2), textured()).mean() + 10


def test_small_pictures_are_refused(metric: vmaf.Vmaf) -> None:
    with pytest.raises(ValueError, match="pictures of 16 x 16 px are too small, 32 x 32 are needed"):
        metric.scores(noise(0, size=16), noise(1, size=16))


def test_an_ffmpeg_without_the_filter_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def listing(*_: Any, **__: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess([], 0, " ... ssim  VV->V\n")

    monkeypatch.setattr(subprocess, "run", listing)
    with pytest.raises(ValueError, match=r"metric=vmaf: .* has no filter libvmaf"):
        vmaf.build(vmaf.Settings())


def test_a_failing_ffmpeg_is_an_error_and_no_score(metric: vmaf.Vmaf, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vmaf, "MODEL", "none_of_this_name")
    with pytest.raises(OSError, match="vmaf: ffmpeg ended with status"):
        metric.scores(textured(), textured())
