"""Observes all cases of all clips by all metrics, and reduces them case by case."""

import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fracgen.config.sensitivity import SensitivityConfig
from fracgen.evaluation import choose, sources
from fracgen.evaluation.metric import Metric, reduced
from fracgen.evaluation.sources import Source
from fracgen.sensitivity.cases import ABOUT, Case, cases
from fracsim.dataset.progress import Progress, shown


@dataclass(frozen=True)
class Line:
    """A result of a case."""

    case: str
    metric: str
    result: str
    value: float
    """NaN where it is undefined."""
    n: int
    """Clips that were observed."""
    higher: bool | None
    """Whether higher is better; None where neither is."""


def run(cfg: SensitivityConfig, progress: Progress = shown) -> list[Line]:
    """All results, by metric, result and case; what cannot be measured is said.

    Raises ValueError for a folder without simulated clips, and for a metric that is not known.
    """
    if not cfg.data:
        raise ValueError("data= is empty: give a folder of simulated clips; python -m fracsim +sweep=sensitivity makes "
                         "some in outputs/sensitivity.")  # fmt: skip
    clips = [one for one in sources.folder(cfg.data, "data", suspect=False).sources if simulated(one)]
    if not clips:
        raise ValueError(f"data={cfg.data} holds no simulated clip: python -m fracsim +sweep=sensitivity makes some.")
    ready = choose.build(choose.choices(cfg.metric, cfg.outside))
    said = {f"no {name}: {why}" for name, why in ready.missing.items()}
    numbers = range(len(clips))[: cfg.limit or None]
    seen = observed(numbers, clips, ready.metrics, cfg, said, progress)
    absent = [name for name in ABOUT if name not in {case for case, _ in seen}]
    if absent:
        said.add(f"no pairs of clips in data={cfg.data} for: {', '.join(absent)}")
    for text in sorted(said):
        print(text, file=sys.stderr)
    return [line for name, metric in ready.metrics.items() for line in lines(name, metric, seen)]


def simulated(one: Source) -> bool:
    """Whether a clip is one whose scene is known, with colour."""
    return one.is_sample and one.row["asset_kind"] is not None and one.row["rgb_file_name"] is not None


def observed(
    numbers: Sequence[int], clips: Sequence[Source], metrics: Mapping[str, Metric], cfg: SensitivityConfig,
    said: set[str], progress: Progress,
) -> dict[tuple[str, str], list[Mapping[str, Any]]]:  # fmt: skip
    """What each metric sees in each case, by (case, metric); why it sees nothing is added to `said`."""
    seen: dict[tuple[str, str], list[Mapping[str, Any]]] = defaultdict(list)
    for number in progress(numbers, len(numbers), "scoring"):
        for case in cases(number, clips, cfg):
            for name, metric in metrics.items():
                try:
                    seen[case.name, name].append(metric.observe(case.pair))
                except ValueError as error:
                    said.add(_told(name, case, error))
    return seen


def _told(metric: str, case: Case, error: ValueError) -> str:
    """Why a metric could not be measured, without the name of the clip, so that it is said once."""
    return f"{metric} is not measured in the case {case.name}: {str(error).replace(case.pair.pred.name, 'a clip')}"


def lines(name: str, metric: Metric, seen: Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]) -> Iterable[Line]:
    """The results of a metric in all cases."""
    for case in ABOUT:
        observations = seen.get((case, name), ())
        for result, value in reduced(metric, observations).items():
            yield Line(case, name, result, float(value), len(observations), metric.higher.get(result))
