"""Device arrays that are used again, since Taichi keeps the memory of arrays that Python has dropped (on CPUs).

Without this, each scene of a sweep in one process would add all its arrays to the memory of the process. On a CPU their
memory is read and written as it lies there: Taichi's own copies need a kernel for each type and number of axes.
"""

import ctypes
import weakref
from collections import defaultdict
from typing import Any

import numpy as np
from taichi.lang import impl
from taichi.lang._ndarray import ScalarNdarray
from taichi.lang.matrix import MatrixNdarray, VectorNdarray
from taichi.lang.util import to_numpy_type

from fracsim.backend import on_cpu
from fracsim.records import Array

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
            array.from_numpy(np.zeros((*shape, *element), to_numpy_type(dtype)))
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


class _InMemory:
    """An array of Taichi that lies in the memory of the host."""

    def _memory(self: Any) -> Array:
        """The memory itself, (N, ...); valid for as long as the array."""
        if self._view is None:
            dtype, shape = np.dtype(to_numpy_type(self.dtype)), (*self.shape, *self.element_shape)
            start = impl.get_runtime().prog.get_ndarray_data_ptr_as_int(self.arr)
            size = int(np.prod(shape)) * dtype.itemsize
            self._view = np.frombuffer((ctypes.c_char * size).from_address(start), dtype).reshape(shape)
        return self._view  # type: ignore[no-any-return]

    _view: Array | None = None

    def to_numpy(self) -> Array:
        """A copy of the values, (N, ...)."""
        return np.array(self._memory())

    def from_numpy(self, values: Array) -> None:
        """Set the values, (N, ...); raises ValueError for another shape."""
        memory = self._memory()
        if values.shape != memory.shape:
            raise ValueError(f"an array of shape {memory.shape} cannot hold values of shape {values.shape}.")
        memory[...] = values


class _Numbers(_InMemory, ScalarNdarray):  # type: ignore[misc]
    """Numbers in the memory of the host."""


class _Vectors(_InMemory, VectorNdarray):  # type: ignore[misc]
    """Vectors in the memory of the host."""


class _Matrices(_InMemory, MatrixNdarray):  # type: ignore[misc]
    """Matrices in the memory of the host."""


def _allocate(element: tuple[int, ...], dtype: Any, shape: tuple[int, ...]) -> Any:
    """A new array; Taichi makes it of zeros."""
    numbers, vectors, matrices = (
        (_Numbers, _Vectors, _Matrices) if on_cpu() else (ScalarNdarray, VectorNdarray, MatrixNdarray)
    )
    if not element:
        return numbers(dtype, shape)
    return vectors(*element, dtype, shape) if len(element) == 1 else matrices(*element, dtype, shape)


def _give_back(taken: list[tuple[Key, Any]]) -> None:
    for key, array in taken:
        _idle[key].append(array)
