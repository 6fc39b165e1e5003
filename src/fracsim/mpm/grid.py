"""The nodes of one simulation on the device: where they lie, what they carry, and how the boundary holds them."""

from typing import Any

import numpy as np
import taichi as ti

from fracsim.arrays import Arrays, power_of_2
from fracsim.mpm.boundary import Holding
from fracsim.mpm.layout import Layout
from fracsim.mpm.transfer import PAD
from fracsim.records import Array

MAX_NODES = 2**25
"""Most nodes of a grid and of all copies together: 1 GiB in float32, or 2 when it has grown."""


class NodeGrid:
    """Device arrays of a layout; see `Grid` and `NodeArrays` for shapes and units."""

    layout: Layout
    index: Any
    source: Any
    shift: Any
    start: Any
    grip: Any
    edge: Any
    edge_weights: Any

    def __init__(self, real: Any, dtype: Any, threads: int) -> None:
        self._real, self._dtype, self._arrays = real, dtype, Arrays(self)
        self.velocity: Any = None
        self.momentum: Any = None
        self.pad = self._arrays.zeros(real, threads * PAD, element=(4,))

    def place(self, layout: Layout, holding: Holding) -> None:
        """Take another layout, whose momenta are zero and whose velocities are not set.

        Raises ValueError for more than MAX_NODES nodes.
        """
        if max(layout.size, layout.copies) > MAX_NODES:
            raise ValueError(f"the grid would need {layout.size:,} nodes: choose fewer solver.cells.")
        self.layout = layout
        self.velocity = self._at_least(self.velocity, layout.size)
        self.momentum = self._at_least(self.momentum, layout.copies)
        self._layout_arrays = Arrays(layout)
        of = self._layout_arrays.of
        self.index, self.source = of(layout.nodes, ti.i32), of(layout.source, ti.i32)
        self.grip, self.edge = of(holding.grip, ti.i32), of(holding.edge, ti.i32)
        self.edge_weights = of(holding.weights, self._real)
        self.shift, self.start = of(layout.shift, ti.i32), of(layout.start, ti.i32)

    def _at_least(self, array: Any, size: int) -> Any:
        """A device array of at least `size` nodes: this one, or a new one twice as large.

        What a substep leaves in an array is zero (`momentum`) or written before it is read.
        """
        if array is not None and array.shape[0] >= size:
            return array
        return self._arrays.zeros(self._real, min(power_of_2(size), MAX_NODES), element=(4,))

    def inherit(self, old: Layout, velocity: Array, old_offset: Array, offset: Array, fragment: Array) -> None:
        """Give nodes the velocity that the node at their place had in the layout `old`.

        `velocity`, (old size, 4), is that of the old nodes; each fragment was `old_offset` and is now `offset` cells
        away from its place, (fragments,); `fragment`, (planes,), is that of each plane of nodes of the present layout.
        """
        index = np.stack(np.unravel_index(self.layout.nodes, self.layout.shape), axis=1)
        of = fragment[index[:, 0]]
        index += self.layout.lowest - old.lowest
        index[:, 0] += old_offset[of] - offset[of]
        known = ((index >= 0) & (index < old.shape)).all(axis=1)  # the others are near failed particles only
        out = np.zeros((self.velocity.shape[0], 4), self._dtype)
        out[self.layout.nodes[known]] = velocity[np.ravel_multi_index(tuple(index[known].T), old.shape)]
        self.velocity.from_numpy(out)

    def clear(self) -> None:
        """Zero whatever a substep that failed half-way has left."""
        for array in (self.pad, self.momentum):
            array.from_numpy(np.zeros_like(array.to_numpy()))

    def arrays(self) -> tuple[Any, ...]:
        """The arrays in the order of the kernel of substeps."""
        grid = (*self.layout.strides, 0.0, self.velocity, self.momentum, self.pad)
        return *grid, self.index, self.grip, self.edge, self.edge_weights, self.source, self.shift, self.start
