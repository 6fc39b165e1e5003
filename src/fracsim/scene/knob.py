"""A validated, documented field of a configuration dataclass."""

import math
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from operator import attrgetter
from typing import Any

from fracsim import registry

KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text", dict: "a mapping"}
"""What to call a value of a type; a bool is an int, so it comes first."""


def text(value: Any) -> str:
    """A value as it is written on the command line."""
    if isinstance(value, (list, tuple)):
        return f"[{','.join(text(item) for item in value)}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{key}:{text(item)}' for key, item in value.items())}}}"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.9g}".replace("e+0", "e").replace("e+", "e")
    return str(value)


@dataclass(frozen=True)
class Knob:
    """What a field means and which values it may take; bounds are inclusive unless `open` names the end.

    The value of a field with a `package` is the name, or a list of names, of modules of this package.
    """

    doc: str
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    open: str = ""
    choices: tuple[str, ...] = ()
    package: str = ""
    pinned: Any = None
    """The default when the field entered, where the default has changed since; it keeps the ids of samples."""

    def allowed(self) -> str:
        """The admissible values, for people; "" when the type says it all."""
        modules = registry.names(self.package) if self.package else ()
        return " | ".join([*self.choices, *modules, *self._range()])

    def _range(self) -> list[str]:
        """The interval and its unit, in a list of one, or none."""
        low, high = math.isfinite(self.least), math.isfinite(self.most)
        if not (low or high):
            return []
        left = ("(" if "least" in self.open else "[") + text(self.least) if low else "(-inf"
        right = text(self.most) + (")" if "most" in self.open else "]") if high else "inf)"
        return [f"{left}, {right} {self.unit}".rstrip()]

    def wanted(self, default: Any) -> str:
        """What a value must be, as the end of a sentence; `default` tells its type."""
        if self.choices:
            names = f"one of {', '.join(self.choices)}" if len(self.choices) > 1 else self.choices[0]
            return " or ".join([names, *(f"a number in {r}" for r in self._range())])
        many = isinstance(default, list)
        one = (default or [0.0])[0] if many else default
        kind = next(words for type_, words in KINDS.items() if isinstance(one, type_))
        return " in ".join([f"a list, each item {kind}" if many else kind, *self._range()])

    def refusal(self, name: str, value: Any, default: Any) -> str:
        """The error for a value that the field called `name` cannot take: what is allowed, and the way out."""
        example = (get_close_matches(str(value), self.choices, n=1) or [text(default)])[0]
        way_out = f" Try {name}={example}." if example else ""
        return f"{name}={text(value)} is not allowed: it must be {self.wanted(default)} ({self.doc}).{way_out}"

    def admits(self, value: Any) -> bool:
        """Whether `value` (a number, a string, a mapping, or a list of these) is admissible; see also `check_names`."""
        if isinstance(value, (list, tuple)):
            return all(self.admits(item) for item in value)
        if isinstance(value, str):
            return not self.choices or value in self.choices
        if isinstance(value, (bool, dict)) or value is None:
            return True
        return math.isfinite(value) and self._above(value) and self._below(value)

    def _above(self, value: float) -> bool:
        return value > self.least if "least" in self.open else value >= self.least

    def _below(self, value: float) -> bool:
        return value < self.most if "most" in self.open else value <= self.most


def knob(default: Any, doc: str, unit: str = "", **limits: Any) -> Any:
    """A dataclass field with documentation, unit and admissible values.

    `limits`: `least`, `most`, `open`, `choices`, `package`, `pinned`, as in `Knob`.
    """
    metadata = {"knob": Knob(doc, unit, **limits)}
    if isinstance(default, (list, dict)):
        return field(default_factory=lambda: type(default)(default), metadata=metadata)
    return field(default=default, metadata=metadata)


def check(section: Any, name: str) -> None:
    """Raise ValueError naming the field, its value and what is allowed for the first bad field of `section`."""
    for f in fields(section):
        rule: Knob | None = f.metadata.get("knob")
        value = getattr(section, f.name)
        if rule is not None and not rule.admits(value):
            raise ValueError(rule.refusal(f"{name}.{f.name}" if name else f.name, value, default_of(f)))


def check_names(config: Any) -> None:
    """Raise ValueError for the first field of `config` that names a module that its package does not have."""
    for name, _, rule in describe(type(config)):
        if rule.package:
            value = attrgetter(name)(config)
            for one in value if isinstance(value, list) else [value]:
                registry.check(rule.package, one, name)


def default_of(f: "Field[Any]") -> Any:
    """The default value of a dataclass field."""
    if f.default is not MISSING:
        return f.default
    return f.default_factory() if f.default_factory is not MISSING else None


def describe(section: type, name: str = "") -> Iterator[tuple[str, Any, Knob]]:
    """Every leaf field below a configuration class as (dotted name, default, knob), in order."""
    for f in fields(section):
        dotted = f"{name}.{f.name}" if name else f.name
        if "knob" in f.metadata:
            yield dotted, default_of(f), f.metadata["knob"]
        elif isinstance(f.type, type) and is_dataclass(f.type):
            yield from describe(f.type, dotted)
