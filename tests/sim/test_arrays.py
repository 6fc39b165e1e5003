"""Device arrays are used again: scenes of a sweep in one process do not add up in memory."""

import gc

import numpy as np
import pytest
import taichi as ti

from fracsim import Solver
from fracsim.arrays import Arrays, power_of_2

from . import bars


class Owner:
    """Something that arrays can belong to."""


def test_arrays_of_an_owner_that_is_gone_are_used_again_and_are_zero() -> None:
    owner, shape = Owner(), (7, 3)
    first = Arrays(owner).of(np.ones((*shape, 2)), ti.f32, (2,))
    other = Owner()
    assert Arrays(other).zeros(ti.f32, *shape, element=(2,)) is not first
    del owner
    again = Arrays(other).zeros(ti.f32, *shape, element=(2,))
    assert again is first
    assert (again.to_numpy() == 0).all()
    assert Arrays(other).like(again).to_numpy().shape == (*shape, 2)


def test_lengths_are_powers_of_two() -> None:
    assert [power_of_2(n) for n in (0, 1, 2, 3, 8, 9)] == [1, 1, 2, 4, 8, 16]


def test_a_second_simulation_needs_no_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same body, pulled twice: all arrays of the second state were those of the first."""
    scene = bars.scene(solver=Solver(cells=40))
    body = bars.bar(scene.solver, (0.6, 0.1, 0.1))

    def run() -> None:
        bars.gripped(scene, body).run(2, 1e-4, 0.0)

    run()
    gc.collect()
    monkeypatch.setattr("fracsim.arrays._allocate", lambda *key: pytest.fail(f"{key} was allocated"))
    run()
