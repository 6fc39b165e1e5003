"""The pressure of a cell: a mean that damage weighs, stresses that are the derivative of one energy, and no locking."""

import numpy as np
import pytest

from fracsim import Fracture, Material, Solver
from fracsim.mpm import params as slot
from fracsim.mpm.layout import cell_counts, order
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.verify.problem import Setting
from fracsim.verify.problems import checkerboard

from . import bars

LAWS = ("fixed_corotated", "neo_hookean", "neo_hookean_decoupled")


def body(law: str, pressure: str = "cell") -> State:
    """A block of 2 x 2 x 2 cells whose particles are strained and damaged at random, one of them failed."""
    solver = Solver(cells=40, precision="float64", pressure=pressure)
    scene = bars.scene(solver=solver, material=Material(law=law, E=1e4, nu=0.45), fracture=Fracture(onset=8, crit=9))
    X = bars.ordered(bars.lattice((0.1,) * 3, solver.spacing), solver.h)
    state, rng = bars.free(scene, bars.particles(X, solver.spacing)), np.random.default_rng(0)
    state.points.F.from_numpy(np.eye(3) + 0.1 * rng.normal(size=(state.n, 3, 3)))
    damage = rng.uniform(0, 0.9, state.n)
    damage[state.n // 2] = 1
    state.points.D.from_numpy(damage)
    state.points.volume.from_numpy(1e-6 * rng.uniform(0.5, 2, state.n))
    return state


def cell(state: State) -> Array:
    """The cell of each particle, (N,)."""
    place = np.floor(state.X0 / state.medium.h - 0.5).astype(int)
    return np.unique(place, axis=0, return_inverse=True)[1].ravel()


def test_particles_that_share_a_cell_have_its_mean() -> None:
    state = body("neo_hookean")
    state.observe()
    w = (1 - state.points.D.to_numpy()) * state.points.volume.to_numpy()
    of, J = cell(state), np.linalg.det(state.points.F.to_numpy())
    assert 1 < np.bincount(of).max() <= 8
    mean = np.bincount(of, w * J) / np.bincount(of, w)
    assert np.allclose(state.points.theta.to_numpy()[w > 0], mean[of][w > 0], rtol=1e-12)


def test_cells_are_runs_of_equal_cells() -> None:
    y = np.array([[1.0, 1, 1], [1.1, 1, 1], [2.1, 1, 1], [1.2, 1, 1]])
    assert cell_counts(y).tolist() == [2, 0, 1, 1]
    assert cell_counts(y[:1]).tolist() == [1]


def test_round_off_decides_nothing_on_the_faces_of_cells() -> None:
    """A lattice in steps of half a cell from a face on, displaced by what float32 rounds at 1 m: eight share a cell."""
    y = np.stack(np.meshgrid(*[np.arange(8) / 2 + 0.5] * 3, indexing="ij"), -1).reshape(-1, 3)
    for seed in range(5):
        noisy = y + np.random.default_rng(seed).uniform(-1e-5, 1e-5, y.shape)
        many = cell_counts(noisy[order(noisy)])
        assert (many[many > 0] == 8).all()


@pytest.mark.parametrize("law", LAWS)
def test_stress_is_the_derivative_of_the_energy_of_all(law: str) -> None:
    """d(sum V (1 - d) psi) / dF_p = V_p P_p although all particles of the cell feel it; so that the energy closes."""
    state, step = body(law), 1e-6

    def energy() -> float:
        return float((state.points.volume.to_numpy() * state.observe()[1]).sum())

    F = state.points.F.to_numpy()
    P = state.observe()[0] @ np.linalg.inv(F).transpose(0, 2, 1)
    for p in (1, state.n // 2 + 1):
        numeric = np.zeros((3, 3))
        for i, j in np.ndindex(3, 3):
            both = []
            for sign in (1, -1):
                G = F.copy()
                G[p, i, j] += sign * step
                state.points.F.from_numpy(G)
                both.append(energy())
            numeric[i, j] = (both[0] - both[1]) / (2 * step) / state.points.volume.to_numpy()[p]
        # Round-off of the sum of some hundred energies: 1e-16 * 100 * psi / step, 1e-8 of the stress.
        assert np.abs(numeric - P[p]).max() < 1e-6 * np.abs(P).max()


@pytest.mark.parametrize("pressure", ["cell", "particle"])
@pytest.mark.parametrize("law", LAWS)
def test_damage_frees_exactly_what_the_body_loses(law: str, pressure: str) -> None:
    """Energy before less energy after a substep in which nearly nothing moves; some are damaged a lot, some fail."""
    state = body(law, pressure)
    state.params[slot.ONSET], state.params[slot.CRIT] = 1.02, 1.2
    before, damage = float(state.points.volume.to_numpy() @ state.observe()[1]), state.points.D.to_numpy()
    state.run(1, 1e-9, 0.0)
    assert (state.points.D.to_numpy() >= 1).sum() >= (damage >= 1).sum() + 5
    after = float(state.points.volume.to_numpy() @ state.observe()[1])
    # Speeds of dt P / (density h), 2e-3 m/s here, take dt^2 P / (density h^2) = 4e-11 of the energy.
    assert state.sums()[slot.DAMAGED] == pytest.approx(before - after, rel=1e-9)


def test_an_even_strain_is_the_same_with_and_without() -> None:
    stresses = []
    for pressure in ("cell", "particle"):
        state = body("neo_hookean", pressure)
        state.points.F.from_numpy(np.tile(np.diag([1.5, 0.8, 0.9]), (state.n, 1, 1)))
        stresses.append(state.observe()[0])
    assert np.allclose(*stresses, rtol=1e-12)


def test_a_nearly_incompressible_bar_does_not_lock() -> None:
    """nu = 0.499, two particles a cell and axis: a fifth too stiff with a pressure a particle, within 1 % here."""
    found = {c.quantity: c.error for c in checkerboard.run(Setting(Solver(), "total"))}
    rough, stress = "rms of p - mean of its neighbours / axial stress", "mean axial stress"
    assert found[f"nu = 0.499: {stress}"] < 0.01
    assert found[f"nu = 0.499: {rough}"] < 0.01
    assert found[f"nu = 0.499, pressure=particle: {stress}"] > 0.1
    assert found[f"nu = 0.499, pressure=particle: {rough}"] > 0.05


def test_cells_of_updated_do_not_keep_their_particles() -> None:
    assert not Solver(formulation="updated").cellwise
    with pytest.raises(ValueError, match=r"solver\.pressure=cell needs .* solver\.formulation=total"):
        Solver(formulation="updated", pressure="cell")
