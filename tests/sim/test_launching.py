"""Launches without checks do what Taichi's own do."""

import numpy as np
import pytest
import taichi as ti

from fracsim.launching import Repeated

pytestmark = pytest.mark.usefixtures("taichi")


def test_repeated_launches_are_those_of_taichi() -> None:
    """Arrays of vectors and of integers, an integer and a float beside them; what the kernel writes is read."""

    @ti.kernel
    def add(
        step: ti.i32,
        values: ti.types.ndarray(dtype=ti.math.vec3, ndim=1),
        counts: ti.types.ndarray(dtype=ti.i32, ndim=2),
        stride: ti.i32,
        scale: ti.f32,
    ):
        for i in values:
            values[i] += scale * ti.Vector([step, i, stride])
            counts[i, 0] += step

    def arrays() -> tuple:
        return ti.ndarray(ti.math.vec3, 4), ti.ndarray(ti.i32, (4, 2))

    plain, fast = arrays(), arrays()
    launch = Repeated(add, *fast, 5, 0.25)
    for step in range(6):
        add(step, *plain, 5, 0.25)
        launch(step)
    for one, other in zip(plain, fast, strict=True):
        np.testing.assert_array_equal(one.to_numpy(), other.to_numpy())
    assert fast[1].to_numpy()[2, 0] == 15
