"""Observes couples: opens each, lets every metric look at it, and stores what it saw. One pair a worker in memory."""

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation import choose, load
from fracgen.evaluation.choose import Choice
from fracgen.evaluation.clip import Clip, LackingError
from fracgen.evaluation.journal import Journal, pair_key
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.pairing import Couple
from fracgen.evaluation.sources import Fault
from fracgen.evaluation.weights import MissingWeightsError
from fracsim.dataset.progress import Progress, shown

AHEAD = 2
"""Couples that wait for each worker."""


@dataclass(frozen=True)
class Seen:
    """What came of a couple: observations by metric, why a metric has none, why there is none at all."""

    observations: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    lacking: dict[str, str] = field(default_factory=dict)
    """Metrics for which the clips have not what is needed, and what it is."""
    broken: dict[str, str] = field(default_factory=dict)
    """Metrics that could not be computed, and why."""
    missing: dict[str, str] = field(default_factory=dict)
    """Metrics whose weights are not there."""
    refused: str = ""


@dataclass
class Observed:
    """The observations of couples, by metric, with the couples they belong to, and what is not there."""

    rows: dict[str, list[tuple[Couple, Mapping[str, Any]]]]
    lacking: list[Fault] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)


def look(couple: Couple, metrics: Mapping[str, Metric], cfg: EvaluateConfig) -> Seen:
    """What the metrics see of a couple."""
    try:
        pair = load.pair(couple, cfg)
    except (ValueError, OSError) as error:
        return Seen(refused=str(error))
    seen = Seen()
    for name, metric in metrics.items():
        try:
            for clip in (pair.pred, pair.gt):
                _check(clip, metric.needs)
            seen.observations[name] = metric.observe(pair)
        except LackingError as error:
            seen.lacking[name] = str(error)
        except MissingWeightsError as error:
            seen.missing[name] = str(error)
        except (ValueError, OSError, RuntimeError, ArithmeticError, IndexError) as error:
            seen.broken[name] = f"{error}" if isinstance(error, ValueError) else f"{type(error).__name__}: {error}"
    return seen


def _check(clip: Clip | None, needs: Sequence[str]) -> None:
    """Raise LackingError unless a clip has all that is needed; before anything of it is decoded."""
    absent = [stream for stream in needs if clip is not None and not clip.has(stream)]
    if clip is not None and absent:
        raise LackingError(f"{clip.name} has no {', '.join(absent)}; it has {', '.join(clip.loads) or 'nothing'}")


def observe(
    couples: Sequence[Couple], chosen: Sequence[Choice], metrics: Mapping[str, Metric], cfg: EvaluateConfig,
    journal: Journal, heading: str = "scoring clips", progress: Progress = shown,
) -> Observed:  # fmt: skip
    """Observe what the journal does not know, and give all."""
    keys = {choice.name: choose.key(choice, metrics[choice.name]) for choice in chosen if choice.name in metrics}
    pairs = [pair_key(couple, cfg) for couple in couples]
    todo = [(k, lacking) for k, pair in enumerate(pairs)
            if (lacking := [name for name, key in keys.items() if journal.get(pair, key) is None])]  # fmt: skip
    out = Observed({name: [] for name in keys})
    work = [(couples[k], names) for k, names in todo]
    for (k, _), seen in zip(todo, progress(_each(work, chosen, metrics, cfg), len(todo), heading), strict=True):
        for name, values in seen.observations.items():
            journal.add(pairs[k], keys[name], values, couples[k].name)
        _note(out, couples[k].name, seen)
    for pair, couple in zip(pairs, couples, strict=True):
        for name, key in keys.items():
            values = journal.get(pair, key)
            if values is not None and name not in out.missing:
                out.rows[name].append((couple, values))
    return out


def _note(out: Observed, clip: str, seen: Seen) -> None:
    """Take down what is not there."""
    if seen.refused:
        out.faults.append(Fault(clip, seen.refused))
    out.faults += [Fault(clip, why, name) for name, why in seen.broken.items()]
    out.lacking += [Fault(clip, why, name) for name, why in seen.lacking.items()]
    out.missing |= seen.missing


def _each(
    work: Sequence[tuple[Couple, list[str]]], chosen: Sequence[Choice], metrics: Mapping[str, Metric],
    cfg: EvaluateConfig,
) -> Iterator[Seen]:  # fmt: skip
    """What is seen of each couple, in order; by several processes if asked for."""
    if cfg.workers == 1 or len(work) < 2:
        for couple, names in work:
            yield look(couple, {name: metrics[name] for name in names}, cfg)
        return
    start = (_start, ([choice for choice in chosen if choice.name in metrics], cfg))
    pool = ProcessPoolExecutor(min(cfg.workers, len(work)), get_context("spawn"), *start)
    try:
        yield from _ahead(pool, _work, work, AHEAD * cfg.workers)
    except BaseException:
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()


def _ahead(pool: ProcessPoolExecutor, call: Callable[..., Seen], work: Sequence[Any], most: int) -> Iterator[Seen]:
    """The results of `call` in order, with at most `most` items on their way."""
    waiting: list[Future[Seen]] = []
    for item in work:
        if len(waiting) >= most:
            yield waiting.pop(0).result()
        waiting.append(pool.submit(call, *item))
    for future in waiting:
        yield future.result()


_here: dict[str, Any] = {}
"""The metrics and the configuration of a worker."""


def _start(chosen: Sequence[Choice], cfg: EvaluateConfig) -> None:
    """Begin a worker: Ctrl-C is for its parent, which stops it."""
    import torch

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(max(1, (os.cpu_count() or 1) // cfg.workers))
    _here.update(metrics=choose.build(chosen).metrics, cfg=cfg)


def _work(couple: Couple, names: Sequence[str]) -> Seen:
    """What a worker sees of a couple."""
    metrics: dict[str, Metric] = _here["metrics"]
    return look(couple, {name: metrics[name] for name in names}, _here["cfg"])
