"""Features are computed once a clip: shared by metrics, and kept on disk for true clips."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracgen.evaluation.clip import Pair
from fracgen.metrics import fvd, kvd
from fracsim import registry
from tests.metrics.feature_clips import clip, counting, pair, video

Make = Callable[..., Any]


@pytest.fixture
def network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A network that counts its calls, and a cache folder of its own."""
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "cache"))
    return counting(tmp_path)


def calls(network: str) -> list[int]:
    return registry.load("fracgen.features", network, "extractor").calls  # type: ignore[no-any-return]


def stored(folder: Path) -> list[Path]:
    return list((folder / "cache" / "features").glob("*.npy"))


def test_fvd_and_kvd_share_the_features_of_a_clip(network: str) -> None:
    metrics = [module.build(module.Settings(extractor=network)) for module in (fvd, kvd)]
    p = pair(0, frames=20)
    for m in metrics:
        m.update(p)
    assert sorted(calls(network)) == [16, 16, 20, 20]
    assert metrics[0].reader is metrics[1].reader


def test_a_clip_of_16_frames_is_looked_at_once(network: str) -> None:
    fvd.build(fvd.Settings(extractor=network)).update(pair(0, frames=16))
    assert calls(network) == [16, 16]


def test_without_the_shorter_clip_nothing_is_computed_for_it(network: str) -> None:
    fvd.build(fvd.Settings(extractor=network, short=0)).update(pair(0, frames=20))
    assert calls(network) == [20, 20]


def test_true_clips_are_not_computed_again_by_the_next_evaluation(network: str, tmp_path: Path) -> None:
    """The same pixels under another name; predicted clips are not kept."""
    first = Pair(clip("a", video(0)), clip("true", video(9)))
    second = Pair(clip("b", video(1)), clip("true again", video(9)))
    observed = [fvd.build(fvd.Settings(extractor=network)).observe(p) for p in (first, second)]
    assert calls(network) == [16] * 3
    assert np.array_equal(observed[0]["gt"], observed[1]["gt"])
    assert len(stored(tmp_path)) == 1


def test_a_damaged_file_of_the_cache_is_made_again(network: str, tmp_path: Path) -> None:
    m = fvd.build(fvd.Settings(extractor=network))
    good = m.observe(pair(0))["gt"]
    (file,) = stored(tmp_path)
    file.write_bytes(file.read_bytes()[:-9])
    assert np.array_equal(m.observe(pair(0))["gt"], good)
    assert np.array_equal(np.load(file), good)


def test_nothing_is_kept_when_not_wanted(network: str, tmp_path: Path) -> None:
    fvd.build(fvd.Settings(extractor=network, keep=False)).update(pair(0))
    assert stored(tmp_path) == []


def test_a_cache_that_cannot_be_written_is_warned_of(
    network: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "file"))
    with pytest.warns(UserWarning, match="Features are not kept .* Set FRACSIM_CACHE"):
        fvd.build(fvd.Settings(extractor=network)).update(pair(0))


def test_copies_of_a_metric_share_the_network_and_nothing_else(network: str) -> None:
    m = fvd.build(fvd.Settings(extractor=network))
    other = deepcopy(m)
    for seed in range(2):
        other.update(pair(seed))
    assert other.reader is m.reader
    assert (m.pred, other.compute()["fvd_n"]) == ([], 2)
    assert not list(m.parameters())
