"""Transfers: every way through the solver gives the same motion, and the pad of a thread the same sums."""

import numpy as np
import pytest
import taichi as ti

from fracsim import Material, Solver
from fracsim.mpm.bspline import weights
from fracsim.mpm.kernels import types
from fracsim.mpm.transfer import PAD, Grid, sum_in_registers, sum_on_pad

from . import bars

SIDE = 4
Vector4, Scalars = types(ti.f64)["vector4"], ti.types.ndarray(dtype=ti.f64, ndim=3)


@ti.kernel
def gather_both(sx: ti.i32, sy: ti.i32, sz: ti.i32, zero: ti.f64, velocity: Vector4, pad: Vector4, out: Scalars):
    wx, wy, wz = weights(ti.f64(0.6)), weights(ti.f64(1.1)), weights(ti.f64(1.4))
    for _ in range(1):
        a = sum_in_registers(ti.static(Grid(sx, sy, sz, velocity, velocity, pad, zero, False)), 1, wx, wy, wz, ti.f64)
        b = sum_on_pad(ti.static(Grid(sx, sy, sz, velocity, velocity, pad, zero, False)), 0, 1, wx, wy, wz)
        for i, j in ti.static(ti.ndrange(4, 3)):
            out[0, i, j], out[1, i, j] = a[i, j], b[i, j]


def test_pad_and_registers_give_the_same_sums() -> None:
    velocity, pad = ti.Vector.ndarray(4, ti.f64, SIDE**3), ti.Vector.ndarray(4, ti.f64, PAD)
    velocity.from_numpy(np.random.default_rng(0).normal(size=(SIDE**3, 4)))
    pad.fill(7.0)  # whatever was there before
    out = np.zeros((2, 4, 3))
    gather_both(SIDE * SIDE, SIDE, 1, 0.0, velocity, pad, out)
    assert np.abs(out[0]).min() > 1e-3
    assert np.allclose(out[0], out[1], rtol=1e-13)


@pytest.mark.parametrize(("formulation", "pressure", "viscosity"), [
    ("total", "cell", 40.0), ("total", "particle", 0.0), ("updated", "auto", 40.0),
])  # fmt: skip
def test_every_drive_gives_the_same_motion(formulation: str, pressure: str, viscosity: float) -> None:
    """Serial, threads (here one more than the cores) and the launches of a GPU: sums in another order, no more. Grips
    hold nodes, and in `total` tie others."""
    solver = Solver(formulation=formulation, pressure=pressure, cells=40, precision="float64")
    scene = bars.scene(solver=solver, material=Material(viscosity=viscosity, decay=1.0))
    body = bars.bar(solver, (0.6, 0.2, 0.1))
    rng, moved = np.random.default_rng(1), {}
    V = rng.normal(size=(len(body), 3))
    for drive, chunks in (("serial", 1), ("threads", 3), ("gpu", 1)):
        state = bars.driven(scene, body, drive, chunks)
        assert (state.grid.edge.to_numpy() >= 0).any() == state.total
        state.points.V.from_numpy(V)
        state.run(20, 2e-4, 0.0)
        arrays = state.points.U.to_numpy(), state.points.F.to_numpy(), state.sums()
        moved[drive] = np.concatenate([a.ravel() for a in arrays])
    assert np.abs(moved["serial"]).max() > 1e-3
    for drive in ("threads", "gpu"):
        assert np.allclose(moved[drive], moved["serial"], rtol=1e-9, atol=1e-12), drive


def test_a_grid_laid_anew_takes_the_memory_of_the_last_one() -> None:
    """Taichi keeps the memory of arrays that are gone: a falling object took more and more until it was killed."""
    solver = Solver(formulation="updated", cells=40)
    state = bars.gripped(bars.scene(solver=solver), bars.bar(solver, (0.6, 0.2, 0.1)))
    arrays = state.grid.velocity, state.grid.momentum
    for _ in range(3):
        state.run(2, 1e-4, 0.0)
        state.relayout(state.X0 + state.points.U.to_numpy())
        assert (state.grid.velocity, state.grid.momentum) == arrays
    state.relayout(2 * state.X0)
    assert state.grid.velocity.shape[0] >= 2 * arrays[0].shape[0]


@pytest.mark.parametrize(("drive", "chunks"), [("serial", 1), ("threads", 3), ("gpu", 1)])
def test_a_call_stops_by_itself_where_a_substep_has_become_too_long(drive: str, chunks: int) -> None:
    """What it then holds is what the same number of substeps gives: nobody is half a substep ahead."""
    solver = Solver(cells=40, precision="float64")
    scene = bars.scene(solver=solver, material=Material(E=1e4))
    body = bars.bar(solver, (0.6, 0.2, 0.1))
    V = np.random.default_rng(1).normal(size=(len(body), 3))

    def moved(n: int, turn: float) -> tuple[int, np.ndarray]:
        state = bars.driven(scene, body, drive, chunks)
        state.points.V.from_numpy(V)
        made = state.run(n, 5e-4, 0.0, turn)
        arrays = (*state.points.changing(), state.grid.velocity)
        return made, np.concatenate([a.to_numpy().ravel() for a in arrays])

    made, early = moved(40, 1e-9)
    assert made == 2  # the first one is too long, the one after it the last
    assert np.allclose(early, moved(2, np.inf)[1], rtol=1e-12, atol=1e-15)
    assert moved(40, 10.0)[0] == 40
