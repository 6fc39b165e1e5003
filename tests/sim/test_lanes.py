"""Particles computed side by side move as they do one by one, and each operation on lanes is that of NumPy."""

import importlib.util
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from fracsim import Backend, Capture, Fracture, Loading, Material, Solver, backend
from fracsim.lab.stage import bar
from fracsim.lanes import WIDTH, Vectors
from fracsim.mpm.boundary import Free
from fracsim.mpm.drive import Drive
from fracsim.mpm.lanes.groups import FIRST, MERGED, SLOTS, Groups, groups
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.solve import setup

from .bars import scene

OPERATIONS = {
    "-a": "-a", "a - b": "a - b", "3 - a": "3 - a", "a / b": "a / b", "2 / a": "2 / a", "a**2": "a**2",
    "a**0.75": "a**0.75", "a**b": "a**b", "ti.sqrt(a)": "np.sqrt(a)", "ti.log(a)": "np.log(a)",
    "ti.exp(a)": "np.exp(a)", "log(a)": "np.log(a)", "log(1 + a / 1024)": "np.log1p(a / 1024)",
    "log(a * 60000)": "np.log(a * 60000)", "log(a / 6000)": "np.log(a / 6000)",
    "ti.sin(a)": "np.sin(a)", "ti.cos(a)": "np.cos(a)", "ti.tan(a)": "np.tan(a)", "ti.asin(a)": "np.arcsin(a)",
    "ti.acos(a)": "np.arccos(a)", "ti.tanh(a)": "np.tanh(a)", "ti.abs(a - b)": "np.abs(a - b)",
    "ti.max(a, 0.5)": "np.maximum(a, 0.5)", "ti.min(a, b)": "np.minimum(a, b)", "ti.atan2(a, b)": "np.arctan2(a, b)",
    "ti.select((a < b) & (a > 0.25), a, 0)": "np.where((a < b) & (a > 0.25), a, 0)",
    "a * total(b)": "a * b.sum(axis=1, keepdims=True)", "a * some(b > 2)": "0 * a", "a * some(b > 0)": "a",
    "matrix([[a, b, 1], [b, a, b], [2, b, a]]).determinant()":
        "np.linalg.det(np.stack([a, b, 1 + 0 * a, b, a, b, 2 + 0 * a, b, a], -1).reshape(*a.shape, 3, 3))",
    "(2 * matrix([[a, b, 1], [b, a, b], [2, b, a]]) @ (1 - matrix([[a, b, b], [b, a, b], [b, b, a]]))).norm_sqr()":
        "(4 * (np.stack([a, b, 1 + 0 * a, b, a, b, 2 + 0 * a, b, a], -1).reshape(*a.shape, 3, 3)"
        " @ (1 - np.stack([a, b, b, b, a, b, b, b, a], -1).reshape(*a.shape, 3, 3))) ** 2).sum(axis=(-1, -2))",
}  # fmt: skip
"""What a law may write, and what NumPy does instead."""
CASES = (
    ("fixed_corotated", "cell", "rigid"),
    ("neo_hookean", "particle", "sliding"),
    ("neo_hookean_decoupled", "cell", "sliding"),
)


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Array, Array, Array]:
    """Two float64 operands, (4, WIDTH), and the results of OPERATIONS, (4, operations, WIDTH)."""
    backend.start(Backend(threads=1))
    lines = "\n".join(f"        R[r, {k}] = {what}" for k, what in enumerate(OPERATIONS, 2))
    path = tmp_path_factory.mktemp("kernel") / "operations.py"
    path.write_text("import taichi as ti\nfrom fracsim.lanes import *\nfrom fracsim.tensor import log\n"
                    "@ti.kernel\ndef run(R: ti.types.ndarray(dtype=ti.types.vector(8, ti.f64), ndim=2)):\n"
                    f"    for r in range(4):\n        a, b = R[r, 0], R[r, 1]\n{lines}\n")  # fmt: skip
    spec = importlib.util.spec_from_file_location("operations", Path(path))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    given = np.zeros((4, 2 + len(OPERATIONS), WIDTH))
    given[:, :2] = np.random.default_rng(0).uniform(0.1, 0.9, (4, 2, WIDTH))
    array = ti.Vector.ndarray(WIDTH, ti.f64, given.shape[:2])
    array.from_numpy(given)
    with Vectors():
        module.run(array)
    out = array.to_numpy()
    return out[:, 0], out[:, 1], out[:, 2:]


@pytest.mark.parametrize("what", OPERATIONS)
def test_an_operation_on_lanes_is_that_of_numpy(what: str, computed: tuple[Array, Array, Array]) -> None:
    a, b, results = computed
    expected = eval(OPERATIONS[what], {"a": a, "b": b, "np": np})
    assert results[:, list(OPERATIONS).index(what)] == pytest.approx(np.asarray(expected, float), rel=1e-12, abs=1e-13)


def test_other_kernels_of_the_process_keep_their_vectors_of_eight() -> None:
    """`+=` of a vector in a field is atomic: two threads lose nothing."""
    backend.start(Backend(threads=2))
    with Vectors():
        pass
    sums = ti.Vector.field(WIDTH, ti.f64, ())

    @ti.kernel
    def add():
        for _ in range(100_000):
            sums[None] += ti.Vector([1.0] * WIDTH)

    add()
    assert (sums[None].to_numpy() == 100_000).all()


def pulled(law: str, pressure: str, boundary: str, precision: str, onset: float = 1.05) -> State:
    """A short bar that tears within a few hundred substeps, with viscosity, decay, gravity and grips."""
    s = scene(
        material=Material(law=law, E=1e4, nu=0.4, density=200, viscosity=2.0, decay=2.0),
        fracture=Fracture(onset=onset, crit=1.15),
        loading=Loading(offset=0.2, thickness=0.1, speed=2.0, gravity=(0.0, -9.8, 0.0), grips=boundary),
        solver=Solver(cells=40, pressure=pressure, precision=precision),
        capture=Capture(frames=1),
    )
    state = setup.state(s, bar(s.solver, (0.55, 0.16, 0.11)))
    state.start()
    return state


def after(state: State, substeps: int) -> dict[str, Array]:
    """What the particles are after some substeps, 25 a call."""
    for k in range(0, substeps, 25):
        state.run(25, 2e-4, k * 2e-4)
        assert state.fault()[0] == 0
    b = state.points
    found: dict[str, Array] = {name: getattr(b, name).to_numpy() for name in ("U", "V", "C", "grad_u", "D")}
    return found | {"sums": state.sums()}


@pytest.mark.parametrize(("law", "pressure", "boundary"), CASES)
def test_lanes_move_as_particles_one_by_one(law: str, pressure: str, boundary: str) -> None:
    """In float64, until after the first have failed. What differs is the order of sums, and that all lanes take the
    steps of Newton's iteration that one of them needs: they are then exact, not off by 2e-9 (`tensor.rotation`)."""
    states = [pulled(law, pressure, boundary, "float64") for _ in range(2)]
    assert states[0].lanes is not None
    states[1].lanes = None
    side_by_side, one_by_one = (after(state, 300) for state in states)
    assert (one_by_one["D"] >= 1).sum() > 8
    for name, values in one_by_one.items():
        scale = np.abs(values).max()
        assert side_by_side[name] == pytest.approx(values, abs=1e-8 * scale), name


def test_what_a_grip_holds_gathers_no_damage_even_from_a_stretch_of_1() -> None:
    state = pulled(*CASES[0], "float64", onset=1.0)
    damage = after(state, 50)["D"]
    assert damage[state.exempt].max() == 0
    assert damage.max() > 0


def test_a_law_that_does_not_say_so_is_computed_one_by_one(tmp_path: Path) -> None:
    """As a law of before lanes, or one with branches."""
    import fracsim.constitutive.neo_hookean as law

    path = tmp_path / "branching.py"
    path.write_text(Path(law.__file__).read_text().replace("LANES = True", "LANES = False"))
    s = scene(material=Material(law=str(path), E=1e4), solver=Solver(cells=40))
    state = setup.state(s, bar(s.solver))
    assert state.lanes is None
    after(state, 25)


def test_threads_move_particles_as_one_does() -> None:
    """They sum the same numbers in another order."""
    s = scene(material=Material(E=1e4, nu=0.3), solver=Solver(cells=40, precision="float64"))
    body = bar(s.solver, (0.55, 0.16, 0.11))
    rng = np.random.default_rng(0)
    v = rng.normal(size=(len(body), 3))
    found = []
    for threads in (1, 2):
        medium = Medium(s.material, Fracture(onset=8, crit=9), s.solver, (0.0, 0.0, 0.0))
        state = State(medium, body, Free(), Drive("serial" if threads == 1 else "threads", threads))
        state.points.V.from_numpy(v)
        found.append(after(state, 50))
    for name, values in found[0].items():
        assert found[1][name] == pytest.approx(values, abs=1e-12 * max(np.abs(values).max(), 1e-12)), name


def grouped(pressure_of: Array, node_of: Array, threads: int = 1) -> Groups:
    """Groups of particles with these numbers of cell and of node."""
    n = len(node_of)
    y = np.zeros((n, 3))
    start = np.searchsorted(pressure_of, np.linspace(0, pressure_of.max() + 1, threads + 1).astype(int))
    return groups(y, np.zeros((n, 3), int), node_of, pressure_of, np.zeros(n, bool), start)


def test_each_particle_has_one_place_beside_those_of_its_node() -> None:
    rng = np.random.default_rng(1)
    node = np.repeat(np.arange(37), rng.integers(1, 12, 37))
    found = grouped(node, node, threads=3)
    places = found.particles[found.particles >= 0]
    assert Counter(places.tolist()) == Counter(range(len(node)))
    for row in found.rows:
        records = found.particles[row[FIRST] : row[FIRST] + row[SLOTS]]
        for lane in range(WIDTH):
            inside = records[:, lane][records[:, lane] >= 0]
            assert set(node[inside]) <= {row[lane]}
    assert not found.rows[:, MERGED].any()


def test_parts_of_a_cell_share_a_group_and_an_owner() -> None:
    """Cells 3, 4 and 11 were cut by a crack, 11 into three fragments."""
    cell = np.repeat(np.arange(20), 8)
    node = cell.copy()
    for k, parts in ((3, 2), (4, 2), (11, 3)):
        node[cell == k] += 100 * (np.arange(8) % parts)
    found = grouped(cell, node)
    homes: dict[int, set[tuple[int, float]]] = {}
    for q, row in enumerate(found.rows):
        records = found.particles[row[FIRST] : row[FIRST] + row[SLOTS]]
        for lane in range(WIDTH):
            for p in records[:, lane][records[:, lane] >= 0]:
                homes.setdefault(int(cell[p]), set()).add((q, float(found.owner[q, lane])))
    assert all(len(of) == 1 for of in homes.values())
    assert len(homes) == 20
    assert len({next(iter(of)) for of in homes.values()}) == 20
