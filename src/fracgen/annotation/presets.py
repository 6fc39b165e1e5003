"""Materials to begin with, and the ranges of their numbers: those of conf/ and of the network, from one source."""

from functools import cache
from typing import Any

from fracgen.conditioning import LIMITS, physical
from fracsim.scene.classes import class_of
from fracsim.scene.condition import Condition
from fracsim.scene.knob import describe
from fracsim.scene.program import SIMULATE
from fracsim.scene.vocab import Asset, Loading

PRESETS = (
    ("Bread, tears early", "bread", "bread"),
    ("Bread, tears late", "bread", "bread_late"),
    ("Rubber, tears early", "rubber", "rubber"),
    ("Rubber, tears late", "rubber", "rubber_late"),
)
"""Name, file of conf/material and file of conf/fracture."""


@cache
def presets() -> list[dict[str, Any]]:
    """Name, category, E [Pa], nu, onset and crit of each of PRESETS."""
    return [_preset(*preset) for preset in PRESETS]


def _preset(name: str, material: str, fracture: str) -> dict[str, Any]:
    scene = SIMULATE.compose(f"material={material}", f"fracture={fracture}")
    m, f = scene.material, scene.fracture
    return {"name": name, "category": class_of(m.law), "E": m.E, "nu": m.nu, "onset": f.onset, "crit": f.crit}


def pull() -> dict[str, float]:
    """The default distance of a grip from the object's centre, in the object's extents, and its speed, a second."""
    size, loading = Asset().size, Loading()
    return {"offset": loading.offset / size, "speed": loading.speed / size}


def ranges() -> dict[str, dict[str, Any]]:
    """By field: what a condition may have (least, most), and what the network knows (low, high; in words, limits)."""
    allowed = {name: rule for name, _, rule in describe(Condition)}
    low, high = physical([-1] * 6), physical([1] * 6)
    return {
        name: {"least": allowed[name].least, "most": allowed[name].most, "low": round(low[name], 9),
               "high": round(high[name], 9), "limits": limits, "doc": allowed[name].doc, "unit": allowed[name].unit}
        for name, limits in LIMITS.items()
    }  # fmt: skip
