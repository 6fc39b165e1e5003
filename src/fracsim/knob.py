"""A validated, documented field of a configuration dataclass."""

import math
from collections.abc import Iterator
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from typing import Any


@dataclass(frozen=True)
class Knob:
    """What a field means and which values it may take; bounds are inclusive unless `open` names the end."""

    doc: str
    unit: str = ""
    least: float = -math.inf
    most: float = math.inf
    open: str = ""
    choices: tuple[str, ...] = ()

    def allowed(self) -> str:
        """The admissible values, for people."""
        if self.choices:
            return " | ".join(self.choices)
        low, high = math.isfinite(self.least), math.isfinite(self.most)
        if not (low or high):
            return ""
        left = ("(" if "least" in self.open else "[") + f"{self.least:g}" if low else "(-inf"
        right = f"{self.most:g}" + (")" if "most" in self.open else "]") if high else "inf)"
        return f"{left}, {right}"

    def admits(self, value: Any) -> bool:
        """Whether `value` (a number, a string, or a list of either) is admissible."""
        if isinstance(value, (list, tuple)):
            return all(self.admits(item) for item in value)
        if isinstance(value, str):
            return not self.choices or value in self.choices
        if isinstance(value, bool) or value is None:
            return True
        return math.isfinite(value) and self._above(value) and self._below(value)

    def _above(self, value: float) -> bool:
        return value > self.least if "least" in self.open else value >= self.least

    def _below(self, value: float) -> bool:
        return value < self.most if "most" in self.open else value <= self.most


def knob(default: Any, doc: str, unit: str = "", **limits: Any) -> Any:
    """A dataclass field with documentation, unit and admissible values (`least`, `most`, `open`, `choices`)."""
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
            unit = f" {rule.unit}" if rule.unit else ""
            raise ValueError(
                f"{name}.{f.name}={value} is not allowed: {rule.doc} must be in {rule.allowed()}{unit}. "
                f"Set {name}.{f.name} to such a value."
            )


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
