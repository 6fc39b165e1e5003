"""One evaluation: from its configuration to results on disk."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation import choose, controls, pairing, plots, report, sources, summary, table, wandb_run
from fracgen.evaluation.coded import vae_of
from fracgen.evaluation.journal import Journal
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.observe import Observed, observe
from fracgen.evaluation.pairing import Paired
from fracgen.evaluation.sources import Fault

VERSION = 1
"""Version of metrics.json."""


@dataclass(frozen=True)
class Done:
    """What an evaluation gives its user."""

    folder: Path
    table: str
    faults: list[Fault]
    told: list[str]
    """Lines about what could not be scored."""
    document: Mapping[str, Any]


def run(cfg: EvaluateConfig) -> Done:
    """Score what a configuration asks for and write the results; raises ValueError, OSError."""
    chosen = choose.choices(cfg.metric, cfg.outside)
    if not chosen:
        raise ValueError("metric=[] holds no metric: name some, as metric=[psnr,sac].")
    ready = choose.build(chosen, cfg.missing_weights)
    found = pairing.pairs(cfg)
    if "vae" in cfg.controls and cfg.vae.path:
        vae_of(cfg.vae)  # bad weights are told before the work
    folder = output(cfg)
    journal = Journal(folder, cfg.output.overwrite)
    seen = observe(found.couples, chosen, ready.metrics, cfg, journal)
    metrics = _with_results(ready.metrics, seen)
    beside = {name: (couples, observe(couples, chosen, metrics, cfg, journal, f"control: {name}"))
              for name, couples in controls.couples(found, cfg).items()}  # fmt: skip
    document = _document(cfg, found, seen, metrics, {**_lacking(seen), **ready.missing, **seen.missing})
    document["controls"] = _controls(cfg, beside, metrics, seen)
    document["faults"] = [asdict(fault) for fault in _faults(found, seen)]
    rows = {name: seen.rows[name] for name in metrics}
    if cfg.plots:
        plots.draw(folder, document, rows)
    report.write(folder, document, rows, metrics)
    if cfg.logger == "wandb":
        wandb_run.log(folder, document, report.clips(rows, metrics), cfg)
    return Done(folder, table.markdown(document, short=True), _faults(found, seen), _told(found, seen), document)


def output(cfg: EvaluateConfig) -> Path:
    """The folder of the results."""
    if cfg.output.folder:
        return Path(cfg.output.folder).expanduser()
    pred = Path(cfg.pred).expanduser()
    return pred / "evaluation" if pred.is_dir() else Path("outputs/evaluation")


def _with_results(metrics: Mapping[str, Metric], seen: Observed) -> dict[str, Metric]:
    """The metrics that at least one clip has an observation of."""
    return {name: metric for name, metric in metrics.items() if seen.rows.get(name)}


def _lacking(seen: Observed) -> dict[str, str]:
    """Why metrics have no observation at all: what no clip has."""
    out = {}
    for name, rows in seen.rows.items():
        faults = [fault for fault in seen.lacking + seen.faults if fault.metric == name]
        if not rows and faults:
            out[name] = f"no clip has what it needs: {faults[0].reason}"
        elif not rows:
            out[name] = "no clip could be read"
    return out


def _faults(found: Paired, seen: Observed) -> list[Fault]:
    """What could not be scored, but for metrics that no clip has what is needed for."""
    some = {name for name, rows in seen.rows.items() if rows}
    return [*found.faults, *seen.faults, *(fault for fault in seen.lacking if fault.metric in some)]


def _told(found: Paired, seen: Observed) -> list[str]:
    """A line for each reason, with the number of clips and the first of them."""
    faults = _faults(found, seen)
    counts = Counter((fault.metric, _alike(fault)) for fault in faults)
    first = {(fault.metric, _alike(fault)): fault.clip for fault in reversed(faults)}
    return [f"{count} clip(s), as {first[metric, why]}: {f'{metric}: ' if metric else ''}{why}"
            for (metric, why), count in counts.items()]  # fmt: skip


def _alike(fault: Fault) -> str:
    """A reason without the name of its clip, so that equal ones can be counted."""
    return re.sub(rf"(?<![\w/]){re.escape(fault.clip)}(?![\w/.])", "it", fault.reason)


def _document(
    cfg: EvaluateConfig, found: Paired, seen: Observed, metrics: Mapping[str, Metric], missing: Mapping[str, str]
) -> dict[str, Any]:
    """The content of metrics.json without controls and faults."""
    return {
        "version": VERSION,
        "command": command(cfg),
        "pred": cfg.pred,
        "gt": cfg.gt,
        "clips": len(found.couples),
        "alone": found.alone,
        "run": sources.described(found.couples[0].pred),
        "settings": {name: value for name, value in asdict(cfg).items() if name not in ("pred", "gt")},
        "metrics": {name: summary.whole(metric, seen.rows[name], cfg.by, cfg.resamples, cfg.seed)
                    for name, metric in metrics.items()},
        "missing": dict(missing),
    }  # fmt: skip


def _controls(
    cfg: EvaluateConfig, beside: Mapping[str, tuple[Sequence[pairing.Couple], Observed]],
    metrics: Mapping[str, Metric], seen: Observed,
) -> dict[str, Any]:  # fmt: skip
    """The results of the controls."""
    out: dict[str, Any] = {}
    for name, (couples, observed) in beside.items():
        found = {metric: summary.results(metrics[metric], rows, 0, cfg.seed)
                 for metric, rows in observed.rows.items() if rows}  # fmt: skip
        out[name] = {"about": controls.ABOUT[name], "n": len(couples), "metrics": found,
                     "faults": [asdict(fault) for fault in observed.faults + observed.lacking]}  # fmt: skip
    rows = seen.rows.get("sac") or []
    if "axis" in cfg.controls and rows and "sac_angle_gt" in metrics["sac"].columns:
        sigma = float(metrics["sac"].about().get("sigma", 15.0))
        out["axis"] = controls.axis(np.array([float(values["sac_angle_gt"]) for _, values in rows]), sigma)
    return out


def command(cfg: EvaluateConfig) -> str:
    """The command that gives these results."""
    parts = [f"pred={cfg.pred}", *([f"gt={cfg.gt}"] if cfg.gt else []), f"metric=[{','.join(cfg.metric)}]"]
    parts += [f"outside=[{','.join(cfg.outside)}]"] if cfg.outside else []
    return f"python -m fracgen.evaluate {' '.join(parts)}"
