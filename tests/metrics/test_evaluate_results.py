"""What results, intervals, controls, frames and sizes of an evaluation are: closed forms and small hand-made cases."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation import bootstrap, controls, load, summary, table
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.pairing import Couple
from fracgen.evaluation.sizes import common
from fracgen.evaluation.sources import Source
from fracgen.evaluation.times import Length, choose
from fracsim.records import Array
from tests.metrics import brightness

N, RESAMPLES = 400, 4000


def means(observed: Any) -> dict[str, float]:
    return {"mean": float(np.mean(observed["x"]))}


def test_the_interval_of_a_mean_is_that_of_the_normal_law() -> None:
    """Of N draws of spread s: 1.96 s / sqrt(N) to both sides.

    The ends are percentiles of RESAMPLES draws: at 2.5 % their standard error is sqrt(p q / RESAMPLES) / density =
    sqrt(.025 x .975 / 4000) / .0584 = .042 of the mean's own; five of these, and the skewness of a mean of N draws,
    which is below 1 / sqrt(N) = .05 of it.
    """
    x = np.random.default_rng(1).normal(3.0, 2.0, N)
    low, high = bootstrap.intervals(means, {"x": x}, RESAMPLES, seed=0)["mean"]
    own = x.std() / math.sqrt(N)
    assert low == pytest.approx(x.mean() - 1.96 * own, abs=0.26 * own)
    assert high == pytest.approx(x.mean() + 1.96 * own, abs=0.26 * own)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """95 % of 300 data sets of 50 draws. Binomial: 3 standard errors are .038; percentiles of 50 draws are narrow by
    sqrt(49/50), which costs .005, and Student's t costs another .007."""
    rng, held = np.random.default_rng(2), 0
    for seed in range(300):
        low, high = bootstrap.intervals(means, {"x": rng.normal(size=50)}, 200, seed)["mean"]
        held += low <= 0 <= high
    assert 0.95 - 0.05 <= held / 300 <= 0.95 + 0.04


def test_intervals_are_the_same_for_the_same_seed_and_none_for_one_clip() -> None:
    observed = {"x": np.arange(9.0)}
    assert bootstrap.intervals(means, observed, 50, 3) == bootstrap.intervals(means, observed, 50, 3)
    assert bootstrap.intervals(means, observed, 50, 3) != bootstrap.intervals(means, observed, 50, 4)
    assert bootstrap.intervals(means, {"x": np.ones(1)}, 50, 3) == {}
    assert bootstrap.intervals(means, observed, 0, 3) == {}


def test_resamples_without_a_result_are_left_out() -> None:
    """The mean of what is defined, of one defined value among three: a third of (2/3)^3 of resamples miss it."""
    observed = {"x": np.array([np.nan, 2.0, np.nan])}
    found = bootstrap.intervals(lambda o: {"mean": float(np.nanmean(o["x"])) if not np.isnan(o["x"]).all() else np.nan},
                                observed, 100, 0)  # fmt: skip
    assert found == {"mean": (2.0, 2.0)}


def test_the_spread_of_a_distance_between_sets_lies_around_it() -> None:
    """Resamples of the number of different clips are below it, about n (1 - 1/e): the interval holds n all the same."""
    observed = {"x": np.arange(40.0)}

    def distinct(o: Any) -> dict[str, float]:
        return {"count": float(len(set(o["x"])))}

    low, high = bootstrap.spreads(distinct, observed, 50, 0)["count"]
    assert low < 40 < high
    assert bootstrap.intervals(distinct, observed, 50, 0)["count"][1] < 40


def rows(values: list[float], groups: list[dict[str, Any]]) -> summary.Rows:
    """Observations of couples with these differences."""
    return [(Couple(Source(str(k), Path(str(k)), str(k)), None, group), {"difference": value, "curve": [value, 0.0]})
            for k, (value, group) in enumerate(zip(values, groups, strict=True))]  # fmt: skip


def metric() -> Metric:
    return brightness.build(brightness.Settings())


def test_results_by_group_are_those_of_its_clips() -> None:
    groups: list[dict[str, Any]] = [
        {"object": "duck", "axis": 90.0},
        {"object": "duck"},
        {"object": "star", "axis": 15.0},
    ]
    entry = summary.whole(metric(), rows([1.0, 3.0, math.nan], groups), ["object", "axis", "speed"], 10, 0)
    assert entry["results"]["difference"]["value"] == 2
    assert (entry["n"], entry["undefined"]) == (3, {"difference": 1})
    duck, star = entry["by"]["object"]["duck"], entry["by"]["object"]["star"]
    assert (duck["n"], duck["results"]["difference"]["value"], duck["results"]["largest"]["value"]) == (2, 2, 3)
    assert star["results"]["difference"] == {"value": None, "low": None, "high": None}
    assert list(entry["by"]) == ["object", "axis"]
    assert list(entry["by"]["axis"]) == ["15", "90"]


def test_observations_of_different_shapes_are_refused() -> None:
    some = rows([1.0, 2.0], [{}, {}])
    longer = {"difference": 1.0, "curve": [0.0, 1.0, 2.0]}
    with pytest.raises(ValueError, match=r"curve has different shapes: \(2,\), \(3,\)"):
        summary.results(metric(), [*some, (some[0][0], longer)], 0, 0)


def test_axes_without_knowledge_have_their_expected_score() -> None:
    """Twelve axes 15 degrees apart: any constant one meets them as a uniform draw does, sum exp(-k^2) / 12.

    The integral is less than this sum by 2 exp(-(pi sigma / 15)^2) = 1.03e-4 of it (Poisson's summation).
    """
    sums = (1 + 2 * sum(math.exp(-(k**2)) for k in range(1, 6)) + math.exp(-36)) / 12
    found = controls.axis(np.arange(12) * 15.0, 15.0)
    assert found["uniform"] == pytest.approx(sums * (1 - 1.03e-4), rel=1e-6)
    assert found["best_constant"] == pytest.approx(sums, rel=1e-6)
    assert found["uniform"] == pytest.approx(0.1477, abs=5e-5)


def test_the_best_constant_axis_is_that_of_most_clips() -> None:
    found = controls.axis(np.array([170.0, 170.0, 170.0, 80.0, np.nan]), 15.0)
    assert (found["best_axis"], found["best_constant"]) == (170, pytest.approx(0.75))
    assert controls.axis(np.array([178.0, 2.0]), 15.0)["best_axis"] == 0
    assert math.isnan(controls.axis(np.array([np.nan]), 15.0)["best_constant"])


SELECT = EvaluateConfig(pred="p")


def numbers(pred: Length, gt: Length, **changes: Any) -> list[int]:
    return choose(pred, gt, EvaluateConfig(pred="p", **changes)).gt.tolist()


def sample(frames: int, fps: float = 100.0, how: str | None = None) -> Length:
    return Length(frames, fps, None, how)


def film(frames: int, played: float = 25.0) -> Length:
    return Length(frames, None, played, None)


def test_frames_are_those_that_the_training_chose() -> None:
    assert numbers(sample(3), sample(9)) == [0, 1, 2]
    assert numbers(sample(3, how="tail"), sample(9)) == [6, 7, 8]
    assert numbers(sample(3, how="linspace"), sample(9)) == [0, 4, 8]
    assert numbers(sample(3, how="linspace"), sample(9), frame_select="head") == [0, 1, 2]
    assert numbers(film(3), sample(9), frame_select="linspace") == [0, 4, 8]
    assert numbers(film(9), film(9)) == list(range(9))


def test_frames_are_those_nearest_in_time() -> None:
    assert numbers(sample(4, fps=50), sample(9), alignment="time") == [0, 2, 4, 6]
    assert numbers(film(4, played=10), film(9, played=25), alignment="time") == [0, 3, 5, 8]
    assert numbers(film(3), sample(9), alignment="time", fps=25) == [0, 4, 8]
    assert choose(sample(4, fps=50), sample(9), EvaluateConfig(pred="p", alignment="time")).fps == 50


def test_frames_are_spread_over_the_true_clip() -> None:
    assert numbers(film(5), sample(9), alignment="spread") == [0, 2, 4, 6, 8]
    assert numbers(film(9), sample(5), alignment="spread") == [0, 1, 1, 2, 2, 3, 3, 4, 4]


@pytest.mark.parametrize(
    ("pred", "gt", "changes", "message"),
    [
        (sample(9), sample(3), {}, "it has 9 frames, and its true clip only 3"),
        (sample(3, fps=50), sample(3), {}, "50 frames a second of simulated time, and its true clip 100"),
        (film(3), film(4), {}, "say by frame_select"),
        (film(3), sample(9), {"alignment": "time"}, "alignment=time needs the rate"),
        (sample(9, fps=50), sample(9), {"alignment": "time"}, "it lasts 0.16 s, and its true clip only 0.08 s"),
    ],
)
def test_lengths_that_do_not_fit_are_refused(pred: Length, gt: Length, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        choose(pred, gt, EvaluateConfig(pred="p", **changes))


def ramp(height: int, width: int) -> Array:
    """A frame whose values grow linearly, (1, H, W, 1)."""
    y, x = np.mgrid[:height, :width]
    return ((x + 0.5) / width + (y + 0.5) / height)[None, ..., None].astype(np.float32)


@pytest.mark.parametrize(("larger", "resize"), [((48, 96), "whole"), ((36, 72), "any")])
def test_the_larger_clip_is_averaged_to_the_size_of_the_smaller(larger: tuple[int, int], resize: str) -> None:
    """Two pixels to one, and three to two: as means over halves of pixels; float32."""
    height, width = larger
    first, second = common((48, 24), (width, height), resize)
    assert np.array_equal(first(ramp(24, 48)), ramp(24, 48))
    halves = ramp(height, width).repeat(2, axis=1).repeat(2, axis=2)
    part = halves.shape[1] // 24
    means = halves.reshape(1, 24, part, 48, part, 1).mean(axis=(2, 4))
    assert np.allclose(second(ramp(height, width)), means, atol=1e-6)
    assert common((width, height), (48, 24), resize)[0] == second


def test_other_sizes_are_refused_with_the_way_out() -> None:
    with pytest.raises(ValueError, match="it has 48 x 24 px, and its true clip 72 x 36, no whole multiple: resize=any"):
        common((48, 24), (72, 36), "whole")
    with pytest.raises(ValueError, match="the shapes differ; crop one of them"):
        common((48, 24), (48, 48), "any")


def test_a_table_for_a_paper_escapes_and_a_number_has_four_digits() -> None:
    assert table.escaped("r2_cons 95 % ↑ –") == r"r2\_cons 95 \% $\uparrow$ --"
    assert [table.number(value) for value in (0.123456, 1234.56, None)] == ["0.1235", "1235", "–"]
    assert table.label("psnr", "psnr_gen") == "psnr_gen"
    assert table.label("map_mse", "mse_flow") == "map_mse.mse_flow"


def test_the_first_frame_of_a_stream_is_repeated() -> None:
    assert load._repeat(np.arange(6).reshape(3, 2)).tolist() == [[0, 1]] * 3
