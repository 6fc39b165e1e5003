"""Metrics by name: their settings, checked, and what their observations rest on beside the clips."""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, make_dataclass
from typing import Any

from fracgen.evaluation import code
from fracgen.evaluation.metric import Metric
from fracgen.evaluation.weights import MissingWeightsError
from fracsim import registry
from fracsim.sample.schema import plain
from fracsim.scene import explain
from fracsim.scene.knob import check_names

PACKAGE = "fracgen.metrics"


@dataclass(frozen=True)
class Choice:
    """A metric that is asked for; it can be sent to other processes, which build it."""

    name: str
    module: str
    """Name of the module, or path of its file."""
    settings: Mapping[str, Any]

    def build(self) -> Metric:
        """The metric; raises MissingWeightsError, and ValueError for what cannot be used."""
        module = registry.load(PACKAGE, self.module, "metric")
        metric = module.build(module.Settings(**self.settings))
        assert isinstance(metric, Metric), self.name
        return metric


def choices(nodes: Mapping[str, Any], outside: Sequence[str] = ()) -> list[Choice]:
    """The metrics that `nodes` names with their fields, and those from `outside`, with checked settings.

    Raises ValueError for an unknown metric, or a field or value that one does not have.
    """
    modules = {name: name for name in nodes if name not in map(registry.label, outside)}
    for name in outside:
        if registry.label(name) in modules:
            raise ValueError(f"outside=[{','.join(outside)}]: there are two metrics called {registry.label(name)}: "
                             "rename a file.")  # fmt: skip
        modules[registry.label(name)] = name
    checked = _checked({label: registry.load(PACKAGE, name, _field(label, name)).Settings
                        for label, name in modules.items()}, nodes)  # fmt: skip
    return [Choice(label, name, checked[label]) for label, name in modules.items()]


def _field(label: str, name: str) -> str:
    return "metric" if label == name else "outside"


def _checked(schemas: Mapping[str, type], nodes: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The fields of each metric by name; raises ValueError for one that is not there or not allowed."""
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    group = make_dataclass("Group", [(name, kind, field(default_factory=kind)) for name, kind in schemas.items()])
    whole = make_dataclass("Metrics", [("metric", group, field(default_factory=group))])
    given = {name: dict(node or {}) for name, node in nodes.items()}
    overrides = [f"metric.{name}.{key}={value}" for name, node in given.items() for key, value in node.items()]
    try:
        found: Any = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(whole), {"metric": given}))
    except OmegaConfBaseException as error:
        see = "conf/metric has a file for each metric."
        raise ValueError(explain.explain(error, overrides, whole, "metric", see)) from None
    check_names(found)
    return {f.name: asdict(getattr(found.metric, f.name)) for f in fields(group)}


@dataclass(frozen=True)
class Ready:
    """The metrics that can be computed, and why others cannot."""

    metrics: dict[str, Metric]
    missing: dict[str, str]


def build(chosen: Sequence[Choice], missing_weights: str = "skip") -> Ready:
    """Build metrics; those whose weights lie nowhere are left out, or raise MissingWeightsError ("error")."""
    metrics, missing = {}, {}
    for choice in chosen:
        try:
            metrics[choice.name] = choice.build()
        except MissingWeightsError as error:
            if missing_weights == "error":
                raise MissingWeightsError(f"{choice.name}: {error}") from None
            missing[choice.name] = str(error)
    return Ready(metrics, missing)


def key(choice: Choice, metric: Metric) -> str:
    """What the observations of a metric rest on beside the clips, as a hash: settings, weights, code.

    16 hex digits.
    """
    module = registry.load(PACKAGE, choice.module, "metric")
    files = [registry.source(PACKAGE, choice.module, "metric")]
    for f in fields(module.Settings):
        rule = f.metadata.get("knob")
        if rule is not None and rule.package:
            with suppress(ValueError):  # a word that stands for no module
                files.append(registry.source(rule.package, choice.settings[f.name], f.name))
    text = repr((choice.name, sorted(choice.settings.items()), plain(metric.about()), code.digest(*files)))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
