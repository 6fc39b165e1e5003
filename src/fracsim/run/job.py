"""One job of Hydra: its configuration becomes one scene, or one for each draw of a list; any launcher may run it."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from fracsim.photo.stage import staged
from fracsim.run import journal, lines, logger
from fracsim.run.attempt import Summary, Task
from fracsim.run.sweep import run_all
from fracsim.scene.program import SIMULATE

RESULTS: list[Summary] = []
"""What the jobs of this process came to; after a sweep those of all its workers."""
journal_size = journal.size


def run(cfg: Any) -> Summary:
    """Run the scenes of a composed configuration; raises KeyboardInterrupt when they were stopped."""
    from hydra.core.hydra_config import HydraConfig
    from hydra.types import RunMode
    from omegaconf import OmegaConf

    hydra = HydraConfig.get()
    overrides: Any = OmegaConf.to_container(hydra.overrides.task, resolve=False)
    todo = tasks(cfg, overrides)
    if hydra.mode == RunMode.MULTIRUN or len(todo) > 1:
        shown = _lines(hydra, cfg, len(todo))
        summary = run_all(_resolved(todo), logger.Logged(shown, _logger(hydra, cfg, len(todo))))
    else:
        summary = run_all(_resolved(todo), lines.One(), record=False, beside=True)
    RESULTS.append(summary)
    if summary.interrupted:
        raise KeyboardInterrupt
    return summary


def finish(results: Sequence[Summary], seconds: float) -> None:
    """Print the totals of a sweep that took `seconds` [s], and keep what its jobs came to."""
    RESULTS[:] = results
    lines.totals(sum(results, Summary()), seconds)


def tasks(cfg: Any, overrides: Sequence[str]) -> list[tuple[Any, tuple[str, ...]]]:
    """A configuration and its overrides for each draw of a list; without a list, the only one."""
    from omegaconf import ListConfig

    if not isinstance(cfg.draw, ListConfig):
        return [(cfg, tuple(overrides))]
    others = [override for override in overrides if not override.startswith("draw=")]
    found = []
    for draw in cfg.draw:
        one = cfg.copy()
        one.draw = draw
        found.append((one, (*others, f"draw={draw}")))
    return found


def _resolved(todo: Sequence[tuple[Any, tuple[str, ...]]]) -> Iterator[Task]:
    """The scene of each configuration, or why it is none."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    for cfg, overrides in todo:
        try:
            yield Task(staged(SIMULATE.resolve(cfg, overrides)), overrides)
        except ValueError as error:
            content: Any = {}
            try:
                content = OmegaConf.to_container(cfg, resolve=True)
            except OmegaConfBaseException:
                content = OmegaConf.to_container(cfg, resolve=False)
            yield Task(None, overrides, str(error), content)


def _logger(hydra: Any, cfg: Any, scenes: int) -> logger.Logger:
    """The logger of this process, under the name of the sweep; only without workers does it see the whole sweep."""
    choices, given = hydra.runtime.choices, hydra.sweeper.get("job")
    total = (given or {}).get("total") or scenes
    alone = choices["hydra/launcher"] == "basic"
    return logger.shared(cfg.logger, cfg.output.folder, choices.get("sweep") or "sweep", total if alone else None)


def _lines(hydra: Any, cfg: Any, scenes: int) -> lines.Lines:
    """The display of a sweep; a sweeper other than that of fracsim says nothing about its job."""
    from hydra_plugins.hydra_fracsim.draws import Job

    given = hydra.sweeper.get("job")
    job = Job(**given) if given and given["total"] else Job(total=scenes)
    return lines.Lines(job, Path(cfg.output.folder), bar=hydra.runtime.choices["hydra/launcher"] == "basic")
