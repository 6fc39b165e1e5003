"""The scenes of a multirun, without running it: `material.E=2e3,6e3`, `draw=range(0,40)`, `+sweep=NAME`.

Hydra's own sweeper makes the jobs. To compose a job takes a tenth of a second, so the scenes of 7,020 draws are not
composed one by one: jobs that differ in `draw` and in plain values only share one composition. The values of a draw
are a pure function of the parameter table (`fracsim.scene.space.resolve`).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from fracsim.scene import space
from fracsim.scene.knob import describe
from fracsim.scene.program import SIMULATE
from fracsim.scene.vocab import Scene

FLAGS = ("-m", "--multirun")
TYPES: dict[str, Any] = {name: type(default) for name, default, _ in describe(Scene)}
"""The type of each field of a scene."""


class Job(NamedTuple):
    """The words of one job of a multirun."""

    overrides: tuple[str, ...]
    """As `python -m fracsim` takes them."""
    values: dict[str, Any]
    """Of the overrides, those of a single field: draw, and fields of a scene."""


def scenes(words: Sequence[str]) -> list[Scene]:
    """The scenes of `python -m fracsim WORDS...`, in the order of the jobs.

    Raises ValueError naming the word that cannot be used.
    """
    return list(_scenes(jobs(words)))


def jobs(words: Sequence[str]) -> list[Job]:
    """The jobs of `python -m fracsim WORDS...`; those in `hydra.sweeper.params` come first, as Hydra has it."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    words = [re.sub(r"^draw=\[(.*)\]$", r"draw=\1", word) for word in words if word not in FLAGS]
    parse = OverridesParser.create().parse_overrides
    try:
        given = parse(words)
        plain = [o.input_line for o in given if not o.is_sweep_override() and o.input_line]
        params = SIMULATE.composed(plain, hydra=True).hydra.sweeper.get("params") or {}
        task = [o for o in given if not o.is_hydra_override()]
        swept = [*parse([f"{key}={value}" for key, value in params.items()]), *task]
        (batch,) = BasicSweeper.split_arguments(swept, None)
        texts = list(dict.fromkeys(text for job in batch for text in job))
        values = {text: _value(override) for text, override in zip(texts, parse(texts), strict=True)}
    except HydraException as error:
        raise ValueError(SIMULATE.explain(error, words)) from None
    return [Job(tuple(job), dict(v for v in map(values.__getitem__, job) if v)) for job in batch]


def _value(override: Any) -> tuple[str, Any] | None:
    """Field and value of an override that sets `draw`, or a field of a scene to a value of the field's own type."""
    if override.type.name != "CHANGE":
        return None
    key, value = override.get_key_element(), override.value()
    wanted = int if key == "draw" else TYPES.get(key)
    if wanted is float and type(value) is int:
        value = float(value)
    plain = wanted in (bool, int, float, str) and type(value) is wanted and "${" not in str(value)
    return (key, value) if plain else None


def _scenes(batch: Sequence[Job]) -> Iterator[Scene]:
    """The scene of each job; one composition for those that differ in plain values only."""
    composed: dict[Any, tuple[Scene, space.Space]] = {}
    for job in batch:
        rest = tuple(o for o in job.overrides if o.partition("=")[0].lstrip("+") not in job.values)
        key = (rest, tuple(job.values), job.values.get("draw", -1) < 0)
        if key not in composed:
            composed[key] = _compose(job.overrides)
        yield _with(*composed[key], job)


def _compose(overrides: Sequence[str]) -> tuple[Scene, space.Space]:
    """The scene of a job as Hydra composes it, and the parameter table that it draws from."""
    from omegaconf import OmegaConf

    cfg = SIMULATE.composed(overrides)
    table: Any = OmegaConf.to_container(cfg.space, resolve=True)
    return SIMULATE.resolve(cfg, overrides), space.Space(**table)


def _with(scene: Scene, table: space.Space, job: Job) -> Scene:
    """`scene` with the draw and the values of a job; raises ValueError for values that are not allowed."""
    draw = job.values.get("draw", -1)
    given = {o.partition("=")[0].lstrip("+~") for o in job.overrides}
    drawn = space.resolve(table, draw) if draw >= 0 else {}
    values = {name: value for name, value in drawn.items() if name not in given}
    return changed(scene, values | {k: v for k, v in job.values.items() if k != "draw"})


def changed(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """A scene with other values of some fields, dotted name -> value; raises ValueError for one not allowed."""
    sections: dict[str, dict[str, Any]] = {}
    for name, value in values.items():
        section, _, leaf = name.rpartition(".")
        sections.setdefault(section, {})[leaf] = value
    whole = sections.pop("", {})
    return replace(scene, **{name: replace(getattr(scene, name), **v) for name, v in sections.items()}, **whole)
