"""Device arrays that are used again, since Taichi keeps the memory of arrays that Python has dropped (on CPUs).

Without this, each scene of a sweep in one process would add all its arrays to the memory of the process.
"""

import weakref
from collections import defaultdict
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.util import to_numpy_type

Key = tuple[tuple[int, ...], Any, tuple[int, ...]]
_idle: dict[Key, list[Any]] = defaultdict(list)
"""Arrays without an owner, by element shape, type and shape."""


def power_of_2(size: int) -> int:
    """The next power of 2: a length that other scenes ask for, too."""
    return 1 << max(size - 1, 0).bit_length()


class Arrays:
    """Makes the arrays of one owner; they may be used by others once the owner is gone."""

    def __init__(self, owner: object) -> None:
        self._taken: list[tuple[Key, Any]] = []
        weakref.finalize(owner, _give_back, self._taken).atexit = False

    def zeros(self, dtype: Any, *shape: int, element: tuple[int, ...] = ()) -> Any:
        """An array of zeros of a Taichi type; `element` is (), (3,) or (3, 3) for numbers, vectors or matrices."""
        key = element, dtype, shape
        if _idle[key]:
            array = _idle[key].pop()
            array.from_numpy(np.zeros((*shape, *element), to_numpy_type(dtype)))  # fill() would compile a kernel
        else:
            array = _allocate(element, dtype, shape)
        self._taken.append((key, array))
        return array

    def of(self, values: Any, dtype: Any, element: tuple[int, ...] = ()) -> Any:
        """An array of a Taichi type that holds `values`, (*shape, *element)."""
        values = np.ascontiguousarray(values, to_numpy_type(dtype))
        array = self.zeros(dtype, *values.shape[: values.ndim - len(element)], element=element)
        array.from_numpy(values)
        return array

    def like(self, array: Any) -> Any:
        """An array of zeros of the type and shape of another."""
        return self.zeros(array.dtype, *array.shape, element=tuple(array.element_shape))


def _allocate(element: tuple[int, ...], dtype: Any, shape: tuple[int, ...]) -> Any:
    """A new array; Taichi makes it of zeros."""
    if not element:
        return ti.ndarray(dtype, shape)
    if len(element) == 1:
        return ti.Vector.ndarray(element[0], dtype, shape)
    return ti.Matrix.ndarray(*element, dtype, shape)


def _give_back(taken: list[tuple[Key, Any]]) -> None:
    for key, array in taken:
        _idle[key].append(array)
