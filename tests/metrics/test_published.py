"""The published comparison: its clips, and what is printed."""

import numpy as np
import pytest

from fracgen.bench import published
from fracsim.records import Array


def test_clips_drawn_one_by_one_are_those_drawn_at_once() -> None:
    at_once = np.random.RandomState(1).rand(2, *published.SHAPE).astype(np.float32)
    assert np.array_equal(np.stack(list(published.noise(1, 2))), at_once)


def test_both_numbers_are_printed(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Features of mean 1 and 3 in two dimensions, of equal covariance: their distance is 4 + 4."""

    def features(seed: int, clips: int) -> Array:
        return np.eye(2)[np.arange(clips) % 2] + 2 * seed

    monkeypatch.setattr(published, "features", features)
    assert published.main(["--clips", "4"]) == 0
    assert capsys.readouterr().out == "FVD of 4 clips: ours 8.000000, published for 128 clips 10.138085\n"
    with pytest.raises(SystemExit):
        published.main(["--clips", "1"])
    assert "--clips 1 is not allowed" in capsys.readouterr().err
