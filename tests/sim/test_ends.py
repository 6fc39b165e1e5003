"""Grips whose faces lie between nodes: the shares of edges, who is tied to whom, and the motion of three tied nodes."""

import numpy as np
import pytest

from fracsim import Capture, Fracture, Loading, Material, Solver
from fracsim.mpm import params as slot
from fracsim.mpm.boundary import IN_EDGE, Holding
from fracsim.mpm.ends import end
from fracsim.mpm.layout import layout, separate_fragments
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.solve.simulator import Simulator

from .bars import bar, gripped, lattice, particles, scene

CELLS = 50
H = 2 / CELLS
SPEED = 0.4


def strained(gap: float, per_cell: int, phase: float) -> tuple[Array, Array, float]:
    """Where the particles of an elastic bar in one dimension are, built anew, their strains and that of the middle, if
    the far end moves as if the bar began `gap` and the soft part before the edge."""
    count, hung = 30, end(1.0)
    nodes = np.arange(-6, count + 1)
    p = (np.arange(per_cell * (count - 4)) + phase) / per_cell - 2
    d = nodes - p[:, None]
    w = np.select([abs(d) < 0.5, abs(d) < 1.5], [0.75 - d**2, (1.5 - abs(d)) ** 2 / 2])
    B = 4 * w * d
    held, edge, pulled = nodes <= 0, nodes == 1, nodes >= count - 8
    motion = np.eye(len(nodes))[:, ~held & ~edge & ~pulled]
    near, far = hung.weights(np.array([gap]))[0]
    motion[np.flatnonzero(edge)[0], :2] = near, far
    u = np.where(pulled, nodes - (1 - gap - hung.soft), 0.0)
    K = B.T @ B
    u = u - motion @ np.linalg.solve(motion.T @ K @ motion, motion.T @ K @ u)
    return p, B @ u, float((B @ u)[np.abs(p - 10).argmin()])


@pytest.mark.parametrize("gap", [0.0, 0.2, 0.45, 0.7, 0.9])
@pytest.mark.parametrize(("per_cell", "phase"), [(2, 0.5), (2, 0.0), (3, 0.3), (8, 0.5)])
def test_a_bar_that_ends_between_nodes_strains_uniformly(gap: float, per_cell: int, phase: float) -> None:
    """The far end moves as if the bar began at the face, so that a strain of 1 is right; 1.5 cells behind the edge
    there is no other, and nearer to it none above 1.3. Two particles a cell do not integrate stiffness exactly: 0.006
    cells of ten."""
    p, strain, middle = strained(gap, per_cell, phase)
    assert middle == pytest.approx(1, abs=1e-3)
    beyond = (p > 1 + 1.5) & (p < 15)
    assert strain[beyond] == pytest.approx(1, abs=0.01 if per_cell < 8 else 2e-3)
    assert strain[p < 15].max() < 1.3


def test_shares_end_where_an_edge_is_held_or_free() -> None:
    """With no gap an edge that is held at rest fulfils the condition: 1.15 a + 2.15 b = 0."""
    hung = end(1.0)
    assert hung.soft == pytest.approx(0.152, abs=1e-3)
    near, far = hung.table[0]
    assert (1 + hung.soft) * near + (2 + hung.soft) * far == pytest.approx(0, abs=1e-3)
    assert (np.diff(hung.table[:, 0]) > 0).all()


def pulled(offset: float, grips: str = "rigid") -> State:
    """A bar at rest between grips that move by SPEED."""
    solver = Solver(cells=CELLS, damping="none", precision="float64")
    s = scene(
        material=Material(law="neo_hookean", E=1e4, nu=0.4),
        fracture=Fracture(onset=8, crit=9),
        loading=Loading(offset=offset, thickness=0.05, speed=SPEED, grips=grips),
        solver=solver,
        capture=Capture(frames=2),
    )
    return gripped(s, bar(solver, (0.8, 0.16, 0.16)))


def held(state: State) -> tuple[Holding, Array]:
    """How the nodes of a state are held, and where they lie [m]."""
    x = state.grid.layout.positions() * state.medium.h
    return state.boundary.holding(state.grid.layout, x), x


@pytest.mark.parametrize("offset", [0.155, 0.162, 0.17, 0.181, 0.2])
def test_each_line_of_nodes_has_one_edge_at_each_face(offset: float) -> None:
    """Nodes up to 0.152 h beyond a face are held, the next one is the edge, and the two behind it are its own."""
    state = pulled(offset)
    hold, x = held(state)
    beyond = (np.abs(np.abs(x[:, 0]) - offset) - 0.025) / H
    assert ((np.abs(hold.grip) == 1) == (beyond <= end(1.0).soft)).all()
    lines = len(np.unique(x[:, 1:].round(6), axis=0))
    first = np.flatnonzero(hold.edge[:, 0] >= 0)
    assert len(first) == 4 * lines
    for other, step in ((hold.edge[first, 0], -1), (hold.edge[first, 1], 1)):
        away = np.sign(beyond[first] - beyond[hold.edge[first, 0]])
        assert (away > 0).all()
        assert np.allclose(np.abs(x[other, 0] - x[first, 0]), H)
        assert np.allclose(beyond[other] - beyond[first], step)
        assert (np.abs(hold.grip[other]) == IN_EDGE).all()
    everyone = np.concatenate([first, *hold.edge[first].T])
    assert len(np.unique(everyone)) == len(everyone)
    assert ((np.abs(hold.grip) == IN_EDGE).sum(), (hold.grip[first] == 0).all()) == (8 * lines, True)


def test_where_grips_are_too_close_the_nearest_nodes_are_held() -> None:
    """Six cells between the faces: two edges, three planes between them, which would be four."""
    state = pulled(0.15)
    hold, x = held(state)
    inside = np.abs(x[:, 0]) < 0.15
    assert (hold.edge[inside] == -1).all()
    assert np.isin(hold.grip[inside], (-1, 0, 1)).all()


def test_fragments_are_not_tied_to_each_other() -> None:
    """Cut one cell behind an edge: the nodes behind it belong to another fragment, or to none."""
    state = pulled(0.162)
    x0 = state.X0
    label = (x0[:, 0] > 0.162 - 0.025 - 1.2 * H).astype(int)
    x, moved, fragment = separate_fragments(x0, label, H)
    grid = layout(x / H, 1, 0)
    at = grid.positions(moved[fragment]) * H
    hold = state.boundary.holding(grid, at)
    of = fragment[np.unravel_index(grid.nodes, grid.shape)[0]]
    first = np.flatnonzero(hold.edge[:, 0] >= 0)
    assert len(first)
    assert (of[hold.edge[first]] == of[first, None]).all()


@pytest.mark.parametrize("grips", ["rigid", "sliding"])
def test_three_nodes_share_a_motion_and_momentum_is_booked(grips: str) -> None:
    """After a substep from random velocities, edges lag as they should, and the grips' impulses are what is missing
    between the momentum of particles and nodes. Across the axis, sliding grips leave everything alone."""
    state = pulled(0.162, grips)
    rng = np.random.default_rng(0)
    V = rng.normal(size=(state.n, 3))
    state.points.V.from_numpy(V)
    state.run(1, 1e-9, 0.0)
    nodes = state.grid.velocity.to_numpy()[state.grid.layout.nodes]
    hold, _ = held(state)
    first = np.flatnonzero(hold.edge[:, 0] >= 0)
    edge, second = hold.edge[first].T
    v = nodes[:, :3].copy()
    drive = np.zeros((len(first), 3))
    drive[:, 0] = np.sign(hold.grip[edge]) * SPEED
    for three in (first, edge, second):
        v[three] -= drive
    axes = slice(0, 1) if grips == "sliding" else slice(0, 3)
    shares = hold.weights[first]
    right = shares[:, :1] * v[first, axes] + shares[:, 1:] * v[second, axes]
    heavy = nodes[edge, 3] > 1e-9
    assert np.allclose(v[edge, axes][heavy], right[heavy], atol=1e-9)
    mass = state.points.volume.to_numpy() * state.medium.material.density
    gained = nodes[:, 3] @ nodes[:, :3] - mass @ V
    booked = state.sums()
    assert gained[0] == pytest.approx(booked[slot.PULL_LOW] + booked[slot.PULL_HIGH], rel=1e-6)
    if grips == "sliding":
        assert np.allclose(gained[1:], 0, atol=1e-6)


def test_particles_of_a_bar_between_nodes_are_stretched_alike() -> None:
    """A slow, damped pull of a bar whose faces lie half-way between nodes: no particle that may fail is stretched more
    than the others by more than what inertia does."""
    h = H
    solver = Solver(cells=CELLS)
    s = scene(material=Material(law="neo_hookean", E=1e4, nu=0.4), solver=solver, fracture=Fracture(onset=8, crit=9),
              loading=Loading(offset=6.6 * h, thickness=2.2 * h, speed=0.02, grips="sliding"),
              capture=Capture(frames=6, fps=1))  # fmt: skip
    body = particles(lattice((18 * h, 4 * h, 4 * h), solver.spacing), solver.spacing)
    simulator = Simulator(s, body)
    *_, last = simulator.frames()
    stretch = np.linalg.svd(last.F.astype(float), compute_uv=False)[:, 0]
    inside = np.abs(simulator.particles.X[:, 0] - 1) / h
    excess = simulator.state.excess
    nominal = simulator.report.history.nominal_stretch[-1]
    beyond = (excess < 5e-3) & (inside < 4)
    assert stretch[beyond] == pytest.approx(nominal, rel=0.02)
    # Nearer to the faces the excess of an elastic bar explains it, times secant over tangent modulus, 1.3 at 1.45.
    beside = (excess >= 5e-3) & (inside < 5.5)
    assert beside.any()
    assert stretch[beside].max() > 1.05 * nominal
    assert (stretch[beside] - 1.3 * excess[beside] * (nominal - 1)).max() < 1.02 * nominal
