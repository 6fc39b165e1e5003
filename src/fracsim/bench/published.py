"""Rows of the paper's parameter table: substeps of a clip, and errors against the reference."""

from collections.abc import Iterator
from pathlib import Path

from fracsim.bench import scenes
from fracsim.bench.record import Row

CLIP = 0.99
"""Simulated time of a clip of 100 frames [s]."""
PAPER = 10_000
"""The paper's substeps of a clip."""
LOW = [(E, damping, most) for E, none in ((2e3, 1 / 9), (6e3, 1 / 4), (1e4, 1 / 4))
       for damping, most in (("physical", 1 / 2), ("none", none))]  # fmt: skip
"""E [Pa], damping, and target of the substeps over the paper's."""
HIGH = [(2e4, 0.45), (2e4, 0.49), (6e4, 0.49), (1e5, 0.45), (1e5, 0.49)]
"""E [Pa] and nu."""


def compared(what: str, name: str, overrides: tuple[str, ...], most: float, error: float) -> Iterator[Row]:
    """Figures of one row of the table: the default preset against the reference."""
    scene = scenes.scene(name, *overrides)
    run = scenes.run(scene)
    errors = run.against(scenes.run(scenes.scene(name, "quality=reference", *overrides)))
    share = run.substeps * CLIP / scene.capture.duration / PAPER
    yield Row(what, "substeps of a clip over the paper's 10,000", share, "1", most=round(most, 4))
    yield Row(what, "error of the break time", errors["break_time"], "1", most=error)
    yield Row(what, "error of the peak load", errors["peak_load"], "1", most=error)
    yield Row(what, "processor time", run.seconds, "s")


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Rows of both classes, with objects of half the usual size on the paper's cells."""
    for E, damping, most in LOW[:1] if quick else LOW:
        overrides = (f"material.E={E:g}", f"solver.damping={damping}")
        yield from compared(f"low stretch, E = {E:g}, damping {damping}", "low stretch", overrides, most, 0.01)
    for E, nu in [] if quick else HIGH:
        overrides = (f"material.E={E:g}", f"material.nu={nu}")
        yield from compared(f"high stretch, E = {E:g}, nu = {nu}", "high stretch", overrides, 2, 0.02)
