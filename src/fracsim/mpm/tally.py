"""Running sums and first faults, one row a thread, so that no thread waits for another."""

from typing import Any, NamedTuple

import taichi as ti


class Ledger(NamedTuple):
    """Where one thread of a CPU, or all of a GPU, writes what it counts."""

    row: Any
    books: Any
    """Running sums, (rows, BOOKS)."""
    faults: Any
    """First fault of each row: kind, particle, substep, (rows, 3)."""
    halt: Any
    """The substep after which to stop, (rows,)."""
    atomic: bool
    """Whether others write to the same row."""


@ti.func
def tally(ledger: ti.template(), slot, amount):
    """Add to a running sum."""
    if ti.static(ledger.atomic):
        ti.atomic_add(ledger.books[ledger.row, slot], amount)
    else:
        ledger.books[ledger.row, slot] = ledger.books[ledger.row, slot] + amount


@ti.func
def report_fault(ledger: ti.template(), kind, p, step):
    """Keep the first fault: its kind, particle and substep."""
    if ledger.faults[ledger.row, 0] == 0:
        ledger.faults[ledger.row, 0] = kind
        ledger.faults[ledger.row, 1] = p
        ledger.faults[ledger.row, 2] = step


@ti.func
def ask_to_halt(ledger: ti.template(), step):
    """Let this substep be the last but the gathering that completes it."""
    ti.atomic_min(ledger.halt[ledger.row], step)
