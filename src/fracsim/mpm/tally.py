"""Sums over time, first faults and requests to stop: one row a thread, so that no thread waits for another."""

from typing import Any, NamedTuple

import taichi as ti


class Tally(NamedTuple):
    """Where one thread of a CPU, or all of a GPU, writes what it counts."""

    row: Any
    sums: Any
    """Sums in SI units, (rows, SUMS)."""
    faults: Any
    """First fault of each row: kind, particle, substep, (rows, 3) int."""
    last: Any
    """Last substep to run, (rows,) int."""
    atomic: bool
    """Whether other threads write to the same row."""


@ti.func
def add(tally: ti.template(), slot, amount):
    """Add to a sum."""
    if ti.static(tally.atomic):
        ti.atomic_add(tally.sums[tally.row, slot], amount)
    else:
        tally.sums[tally.row, slot] = tally.sums[tally.row, slot] + amount


@ti.func
def report_fault(tally: ti.template(), kind, p, step):
    """Keep the first fault of the row: its kind, particle and substep."""
    if tally.faults[tally.row, 0] == 0:
        tally.faults[tally.row, 0] = kind
        tally.faults[tally.row, 1] = p
        tally.faults[tally.row, 2] = step


@ti.func
def request_stop(tally: ti.template(), step):
    """Make this substep the last one; the next gathering completes it."""
    ti.atomic_min(tally.last[tally.row], step)
