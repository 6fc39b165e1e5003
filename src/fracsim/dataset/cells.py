"""The clips of a data set by the values of two parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from fracsim.dataset.page import Key
from fracsim.sample import Sample, read
from fracsim.sample.identity import FRACSIM, field_of, pinned_defaults
from fracsim.scene.knob import text
from fracsim.scene.vocab import Scene


@dataclass
class Cell:
    """The clips with one pair of values: the first of them, and how many there are."""

    sample: Sample
    count: int = 1

    @property
    def breaks(self) -> int | None:
        """Frame of the break."""
        found = self.sample.meta["report"].get("break_frame")
        return None if found is None else int(found)

    @property
    def words(self) -> str:
        """What is written below the picture."""
        when = "holds" if self.breaks is None else f"breaks at {self.breaks}"
        return when + (f"; first of {self.count}" if self.count > 1 else "")


def collect(folder: Path | str, by: tuple[str, str], only: Mapping[str, str]) -> dict[Key, Cell]:
    """The finished clips in a folder by the values of two parameters, those that have the values `only`.

    Raises ValueError for a parameter that is no field of a scene, and when no clip is left.
    """
    for name in (*by, *only):
        if name not in pinned_defaults(Scene):
            near = get_close_matches(name, pinned_defaults(Scene), n=1, cutoff=0.4)
            way_out = f"did you mean {near[0]}?" if near else "see python -m fracsim --help."
            raise ValueError(f"{name} is no parameter of a scene: {way_out}")
    cells: dict[Key, Cell] = {}
    for meta in sorted(Path(folder).expanduser().glob("*/meta.json")):
        try:
            sample = read(meta.parent)
            values = parameters(sample)
        except ValueError:  # not finished, or not of this version
            continue
        if all(_same(values[name], wanted) for name, wanted in only.items()):
            key = values[by[0]], values[by[1]]
            if key in cells:
                cells[key].count += 1
            else:
                cells[key] = Cell(sample)
    if not cells:
        left = "".join(f" with {name}={value}" for name, value in only.items())
        raise ValueError(f"{folder} has no finished clip{left}: give the folder of a data set.")
    return cells


def parameters(sample: Sample) -> dict[str, Any]:
    """All fields of the scene of a sample, dotted name -> value; raises ValueError for another producer."""
    if sample.producer == FRACSIM and sample.meta["content"]:
        values = {**pinned_defaults(Scene), **sample.meta["content"]}
    else:
        values = {name: field_of(sample.scene, name) for name in pinned_defaults(Scene)}
    return {name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}


def _same(value: Any, wanted: str) -> bool:
    """Whether a value is the one written on the command line."""
    try:
        return float(value) == float(wanted)
    except (TypeError, ValueError):
        return text(value) == wanted
