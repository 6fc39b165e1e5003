"""A condition: one pull on one object in one picture, as a JSON file.

`python -m fracsim asset=image condition=FILE`, `python -m fracgen.sample condition=FILE` and the annotation page read
and write the same file.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from fracsim.records import Array
from fracsim.scene.knob import check, describe, knob

OPTIONAL = ("fps", "caption")
"""Fields that a file may leave out."""


@dataclass(kw_only=True)
class Condition:
    """One pull on one object in one picture; positions are in picture widths and heights from the top left corner.

    The same fields are a condition file (JSON), a row of a data set, and what the annotation page exports.
    """

    E: float = knob(6e3, "Young's modulus", "Pa", least=1e2, most=1e10)
    nu: float = knob(0.25, "Poisson's ratio", least=0.0, most=0.5)
    category: str = knob("low_stretch", "kind of fracture", choices=("low_stretch", "high_stretch"))
    onset: float = knob(1.5, "stretch at which damage begins", least=1.0, most=10.0)
    crit: float = knob(2.3, "stretch at which the material has failed", least=1.0, most=10.0, open="least")
    grips: list[float] = knob([0.35, 0.5, 0.65, 0.5], "centres of the two grips in frame 0: x1, y1, x2, y2",
                              least=-2, most=3)  # fmt: skip
    velocity: list[float] = knob([-0.3, 0.0, 0.3, 0.0], "their velocities, x right and y down: vx1, vy1, vx2, vy2",
                                 "1/s", least=-100, most=100)  # fmt: skip
    fps: float = knob(100.0, "frames a second of simulated time", "1/s", least=1.0, most=1e5)
    caption: str = knob("", "what happens, in words; empty = made from the category and the axis")

    def __post_init__(self) -> None:
        check(self, "condition")
        for name in ("grips", "velocity"):
            if len(getattr(self, name)) != 4:
                raise ValueError(
                    f"condition.{name}={getattr(self, name)} must have four numbers: x and y of each grip."
                )
        if self.crit <= self.onset:
            raise ValueError(f"condition.crit={self.crit} must be greater than condition.onset={self.onset}: "
                             "raise crit or lower onset.")  # fmt: skip

    def paths(self, frames: int, width: int, height: int) -> Array:
        """Positions of the grips [px], (F, 2, 2): frame k shows them at k / fps."""
        time = np.arange(frames)[:, None, None] / self.fps
        size = np.array([width, height], dtype=np.float64)
        return np.asarray((np.reshape(self.grips, (2, 2)) + time * np.reshape(self.velocity, (2, 2))) * size)


def load(path: Path | str) -> Condition:
    """The condition in a JSON file; raises ValueError naming the file, and the field that is missing or wrong."""
    try:
        content = json.loads(Path(path).expanduser().read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ValueError(f"condition={path} cannot be read ({error}): give a JSON file with the fields of "
                         "fracsim.scene.condition.Condition.") from None  # fmt: skip
    return parse(content, f"condition={path}")


def parse(content: Any, source: str) -> Condition:
    """The condition that decoded JSON holds; raises ValueError naming `source`, and the field that is wrong."""
    known = [f.name for f in fields(Condition)]
    needed = [name for name in known if name not in OPTIONAL]
    if not isinstance(content, dict) or [n for n in needed if n not in content] or set(content) - set(known):
        given = list(content) if isinstance(content, dict) else type(content).__name__
        raise ValueError(f"{source} has {given}: a condition has {', '.join(needed)}, and may have "
                         f"{' and '.join(OPTIONAL)}.")  # fmt: skip
    _check_types(content, source)
    try:
        return Condition(**{name: _floats(value) for name, value in content.items()})
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{source}: {error}") from None


def _floats(value: Any) -> Any:
    """A number, or each of a list, as a float; raises OverflowError for a whole number beyond them."""
    if isinstance(value, list):
        return [float(v) for v in value]
    return value if isinstance(value, str) else float(value)


def _check_types(content: Mapping[str, Any], source: str) -> None:
    """Raise ValueError for a field of another type than its default."""
    for name, default, rule in describe(Condition):
        value = content.get(name, default)
        numbers = value if isinstance(default, list) and isinstance(value, list) else [value]
        kind = str if isinstance(default, str) else (int, float)
        if isinstance(default, list) != isinstance(value, list) or any(
            isinstance(v, bool) or not isinstance(v, kind) for v in numbers
        ):
            raise ValueError(f"{source}: {rule.refusal(name, value, default)}")


def text(condition: Condition) -> str:
    """The content of a condition file."""
    return json.dumps(asdict(condition), indent=2) + "\n"


def save(condition: Condition, path: Path | str) -> None:
    """Write a condition file."""
    Path(path).write_text(text(condition), encoding="utf-8")
