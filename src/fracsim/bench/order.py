"""Do later thresholds tear later? The frame at which objects part, for pairs of thresholds, at `quality=preview`.

Six scenes are pulled with six pairs, and rows of the paper's table, of all ten objects, with both pairs of their class.
A pair is later than another if neither threshold is lower. `violated` counts pairs of scenes whose later one parts in
an earlier frame.
"""

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path

from fracsim import backend
from fracsim.asset.build import build_of
from fracsim.bench.order_sheet import Case, draw
from fracsim.bench.record import Row
from fracsim.scene.classes import OBJECTS
from fracsim.scene.program import compose
from fracsim.scene.vocab import Scene
from fracsim.solve.simulator import Simulator

Pair = tuple[float, float]
PAIRS: tuple[Pair, ...] = ((1.5, 2.3), (1.8, 2.3), (2.0, 2.3), (2.0, 3.0), (2.3, 3.0), (2.6, 3.0))
"""lambda_onset and lambda_crit."""
SCENES = {
    "bread": ("asset=bread",),
    "bread, offset 0.1": ("asset=bread", "loading.offset=0.1"),
    "croissant": ("asset=croissant", "loading.speed=0.5", "loading.offset=0.25"),
    "bear, offset 0.1": ("asset=bear", "loading.offset=0.1"),
    "bar, rubber": ("asset=bar", "material=rubber", "loading.speed=0.8"),
    "duck, rubber, 30 degrees": ("asset=duck", "material=rubber", "loading.speed=0.8", "loading.axis_deg=30"),
}
TABLE = (100, 450)
"""Rows of the parameter table."""
CLASSES = {"low_stretch": ((1.5, 2.3), (2.0, 3.0)), "high_stretch": ((2.6, 3.0), (3.0, 3.3))}
"""The two pairs of each class."""
QUICK = ("bread, offset 0.1",)
FRAMES = 90


def pulled(overrides: tuple[str, ...], onset: float, crit: float) -> Scene:
    """A scene with a pair of thresholds."""
    return compose("quality=preview", *overrides, f"fracture.onset={onset}", f"fracture.crit={crit}",
                   f"capture.frames={FRAMES}")  # fmt: skip


def breaks(s: Scene) -> float:
    """The frame at which a scene parts, infinite if it does not."""
    backend.start(s.backend)
    simulator = Simulator(s, build_of(s))
    for _ in simulator.frames():
        if simulator.report.parted:
            break
    frame = simulator.report.break_frame
    return math.inf if frame is None else frame


def violations(frames: dict[Pair, float]) -> list[tuple[Pair, Pair]]:
    """Pairs of thresholds, earlier and later, of which the later one parts in an earlier frame."""
    ordered = [(a, b) for a in frames for b in frames if a != b and a[0] <= b[0] and a[1] <= b[1]]
    return [(a, b) for a, b in ordered if frames[b] < frames[a]]


def pulls() -> Iterator[tuple[str, tuple[str, ...], tuple[Pair, ...]]]:
    """Name, overrides and pairs of thresholds of each scene."""
    for name, overrides in SCENES.items():
        yield name, overrides, PAIRS
    for stretch, pairs in CLASSES.items():
        for name, row in product(OBJECTS[stretch], TABLE):
            yield f"{name}, row {row}", (f"asset={name}", f"draw={row}"), pairs


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Break frames of all scenes; a picture of the worst violation of each is written to `out`."""
    couples = []
    for name, overrides, pairs in pulls():
        if quick and name not in QUICK:
            continue
        frames = {}
        for pair in pairs:
            frames[pair] = breaks(pulled(overrides, *pair))
            yield Row(f"order, {name}", f"thresholds {pair[0]:g} / {pair[1]:g}: parts in frame", frames[pair], "1")
        found = violations(frames)
        where = "".join(f"; {b[0]:g} / {b[1]:g} before {a[0]:g} / {a[1]:g}" for a, b in found)
        yield Row(f"order, {name}", f"violated{where}", float(len(found)), "1", most=0)
        if found:
            first, second = max(found, key=lambda ab: frames[ab[0]] - frames[ab[1]])
            couples.append((_case(name, overrides, first, frames), _case(name, overrides, second, frames)))
    if couples:
        out.mkdir(parents=True, exist_ok=True)
        draw(out / "order.png", couples)


def _case(name: str, overrides: tuple[str, ...], pair: Pair, frames: dict[Pair, float]) -> Case:
    """A scene with a pair of thresholds, to be drawn."""
    return Case(f"{name}: {pair[0]:g} / {pair[1]:g}", pulled(overrides, *pair), int(frames[pair]))
