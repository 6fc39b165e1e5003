"""Depth order and tile lists against sorting and looping in NumPy."""

import numpy as np
import pytest

from fracsim.render import tiles


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_depth_order_is_a_stable_sort(dtype):
    rng = np.random.default_rng(0)
    depth = rng.choice(rng.gamma(1.0, 3.0, 700), 5000).astype(dtype)  # with ties
    depth[::17] = 0
    np.testing.assert_array_equal(tiles.depth_order(depth), np.argsort(depth, kind="stable"))


@pytest.mark.parametrize("n", [1, 3, 2000])
def test_each_tile_lists_its_gaussians_nearest_first(n):
    rng = np.random.default_rng(n)
    rows, columns = 3, 5
    order = rng.permutation(n).astype(np.int32)
    first = np.stack([rng.integers(0, columns, n), rng.integers(0, rows, n)], axis=1)
    size = rng.integers(0, 3, (n, 2))
    rectangle = np.concatenate([first, np.minimum(first + size, [columns, rows])], axis=1).astype(np.int32)
    table = np.full((tiles.CHUNKS, rows, columns), -7, np.int32)
    tiles.count(order, rectangle, table)
    table, starts = tiles.starts(table)
    entries = np.full(max(starts[-1], 1), -1, np.int32)
    tiles.fill(order, rectangle, table, entries)
    for t in range(rows * columns):
        y, x = divmod(t, columns)
        x0, y0, x1, y1 = rectangle[order].T
        expected = order[(x0 <= x) & (x < x1) & (y0 <= y) & (y < y1)]
        np.testing.assert_array_equal(entries[starts[t] : starts[t + 1]], expected)


def test_more_entries_than_int32_can_number_are_an_error():
    with pytest.raises(ValueError, match="camera: the Gaussians meet"):
        tiles.starts(np.full((tiles.CHUNKS, 2, 2), 2**25, np.int32))
