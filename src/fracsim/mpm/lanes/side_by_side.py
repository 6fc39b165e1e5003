"""The particles of one simulation in lanes: where each lies, and the launches that move them (`total`, on a CPU)."""

from typing import Any

import numpy as np
import taichi as ti

from fracsim.arrays import Arrays, power_of_2
from fracsim.lanes import WIDTH, Vectors
from fracsim.launching import Repeated
from fracsim.mpm.context import Variant
from fracsim.mpm.drive import Drive
from fracsim.mpm.grid import NodeGrid
from fracsim.mpm.lanes.groups import SLOTS, groups
from fracsim.mpm.lanes.kernels import exchange, lane_substeps
from fracsim.mpm.lanes.record import FIELDS, FORCE, KEPT, MOTION
from fracsim.mpm.lanes.transfer import PLACES
from fracsim.mpm.layout import Layout, cells
from fracsim.mpm.points import Points
from fracsim.records import Array

APART = 16
"""Records between those of two threads: a multiple of a cache line, and more than one."""


class SideBySide:
    """Device arrays of groups of cells; see `LaneArrays` for shapes and units."""

    def __init__(self, real: Any, drive: Drive) -> None:
        self._real, self._drive = real, drive
        self._record: Any = None

    def place(self, y: Array, layout: Layout, cell_starts: Array | None, held: Array, forced: bool) -> None:
        """Group the particles at y [cells from the object's centre], (N, 3), of a layout.

        `cell_starts`, (cells,) int, are the first particles of cells that share a pressure, None where each particle
        has its own; `held`, (N,) bool, are those in grips; `forced`: whether body forces act.
        """
        y = y.astype(np.float64)
        cell = cells(y)
        node = (cell - layout.lowest) @ np.asarray(layout.strides)
        pressure = node if cell_starts is None else np.searchsorted(cell_starts, np.arange(len(y)), side="right")
        found = groups(y, cell, node, pressure, held, layout.start)
        self._arrays = Arrays(found)
        make, self._found, threads, records = self._arrays, found, self._drive.threads, len(found.particles)
        most = int(found.rows[:, SLOTS].max(initial=1))
        self._slots = (most + 2 * APART - 1) // APART * APART
        room = power_of_2(records)
        self.rows, self.particle = make.of(found.rows, ti.i32), make.of(found.particles, ti.i32)
        self.owner = make.of(found.owner, self._real, (WIDTH,))
        self.first, self.offset = make.of(found.start, ti.i32), make.of(found.offset, self._real, (3,))
        self.record = make.zeros(self._real, room, FIELDS if forced else FORCE, element=(WIDTH,))
        self.motion = make.zeros(self._real, room, MOTION, element=(WIDTH,))
        self.kept = make.zeros(self._real, threads * self._slots, KEPT, element=(WIDTH,))
        self.pad = make.zeros(self._real, threads * PLACES, element=(WIDTH,))

    def run(self, count: int, variant: Variant, params: Any, points: Points, grid: NodeGrid, tally: tuple[Any, ...],
            wide: Any) -> None:  # fmt: skip
        """Make `count` substeps."""
        load, store = exchange(self._real, variant.forced)
        b = points
        kernel = lane_substeps(variant, self._drive.kind == "threads", wide)
        arrays = (params, self.rows, self.owner, self.particle, self.record, self.motion, self.kept, self.pad,
                  self._slots, self.first, *grid.arrays(), *tally)  # fmt: skip
        with Vectors():
            load(self.particle, self.record, self.motion, self.offset, b.U, b.V, b.C, b.grad_u, b.D, b.volume, b.tag,
                 b.force)  # fmt: skip
            launch = Repeated(kernel, count, *arrays)
            for step in range(1 if self._drive.kind == "serial" else count + 1):
                launch(step)
            store(self.particle, self.record, self.motion, b.U, b.V, b.C, b.grad_u, b.D)
