"""Sizes of the measurements."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Plan:
    """Sizes and repeats of one run of the benchmark; the targets apply to `FULL`."""

    name: str
    """`full` or `quick`."""
    cells: int
    """Cells along the 2 m domain; the bar of 0.6 x 0.2 x 0.2 m has 8 particles a cell."""
    substeps: int
    """Substeps in one timing."""
    rounds: int
    """Timings of each competitor."""
    gaussians: int
    """Gaussians of the rasteriser's image."""
    pixels: int
    """Width and height of this image [px]."""
    run: tuple[str, ...]
    """Overrides of the run for cold and warm start; those of `make demo` in `FULL`."""
    memory_cells: int
    """Cells along the domain for the peak memory: a bar of 200,000 particles needs 203."""


FULL = Plan("full", 150, 16, 9, 100_000, 512, ("capture.frames=40",), 203)
QUICK = Plan("quick", 30, 4, 2, 2_000, 64, ("quality=preview", "solver.cells=40", "capture.frames=3"), 50)
