"""Rows of the paper's parameter table: substeps for a clip and errors against the reference."""

from collections.abc import Iterator
from pathlib import Path

from fracsim.bench import scenes
from fracsim.bench.record import Row

CLIP = 0.99
"""Simulated time of a clip of 100 frames [s]."""
PAPER = 10_000
"""The paper's substeps for it."""
LOW = [(E, damping, most) for E, none in ((2e3, 1 / 9), (6e3, 1 / 4), (1e4, 1 / 4))
       for damping, most in (("physical", 1 / 2), ("none", none))]  # fmt: skip
"""E [Pa], damping, and how many of the paper's substeps it may take."""
HIGH = [(2e4, 0.45), (2e4, 0.49), (6e4, 0.49), (1e5, 0.45), (1e5, 0.49)]
"""E [Pa] and nu."""


def compared(what: str, name: str, overrides: tuple[str, ...], most: float, error: float) -> Iterator[Row]:
    """One row of the table, with the default preset and with the reference."""
    scene = scenes.scene(name, *overrides)
    found = scenes.run(scene)
    wrong = found.against(scenes.run(scenes.scene(name, "quality=reference", *overrides)))
    share = found.substeps * CLIP / scene.capture.duration / PAPER
    yield Row(what, "substeps of a clip over the paper's 10,000", share, "1", most=round(most, 4))
    yield Row(what, "error of the break time", wrong["break_time"], "1", most=error)
    yield Row(what, "error of the peak load", wrong["peak_load"], "1", most=error)
    yield Row(what, "processor time", found.seconds, "s")


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Both classes; objects of half the usual size at the paper's cell size."""
    for E, damping, most in LOW[:1] if quick else LOW:
        words = (f"material.E={E:g}", f"solver.damping={damping}")
        yield from compared(f"low stretch, E = {E:g}, damping {damping}", "low stretch", words, most, 0.01)
    for E, nu in [] if quick else HIGH:
        words = (f"material.E={E:g}", f"material.nu={nu}")
        yield from compared(f"high stretch, E = {E:g}, nu = {nu}", "high stretch", words, 2, 0.02)
