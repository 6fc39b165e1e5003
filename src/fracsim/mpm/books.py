"""Running sums and first faults, one row a thread, so that no thread waits for another."""

import taichi as ti


@ti.func
def tally(books: ti.template(), row, slot, amount, atomic: ti.template()):
    """Add to a slot of a row; a row belongs to one thread on a CPU and to all of them on a GPU."""
    if ti.static(atomic):
        ti.atomic_add(books[row, slot], amount)
    else:
        books[row, slot] = books[row, slot] + amount


@ti.func
def report_fault(faults: ti.template(), row, kind, p, step):
    """Keep the first fault of a row: its kind, particle and substep."""
    if faults[row, 0] == 0:
        faults[row, 0] = kind
        faults[row, 1] = p
        faults[row, 2] = step
