"""A torn object that has come to rest is not simulated any longer, and moves on as it would have."""

import numpy as np
import pytest

from fracsim import Capture, Fracture, Loading, Material, Solver
from fracsim.solve.settled import STILL
from fracsim.solve.simulator import Simulator

from .bars import bar, scene

FRAMES, SPEED = 60, 0.5


def pulled(until: str, crit: float = 2.0, **solver: object) -> Simulator:
    """A bar as viscous as bread that tears early."""
    s = scene(
        material=Material(law="fixed_corotated", E=6e3, nu=0.25, viscosity=60, decay=5),
        fracture=Fracture(onset=1.2, crit=crit),
        loading=Loading(offset=0.12, speed=SPEED, thickness=0.06),
        solver=Solver(cells=50, until=until, **solver),
        capture=Capture(frames=FRAMES),
    )
    return Simulator(s, bar(s.solver, (0.4, 0.16, 0.16)))


def test_settled_pieces_move_on_as_they_would_have() -> None:
    whole, early = pulled("end"), pulled("settled")
    (*_, last), (*_, same) = whole.frames(), early.frames()
    settled = early.report.settled_frame
    assert settled is not None
    assert whole.report.break_frame == early.report.break_frame < settled < FRAMES - 10
    assert early.report.substeps < 0.8 * whole.report.substeps
    # What was slower than STILL v can have moved at most that much for the rest of the time.
    left = (FRAMES - 1 - settled) / 100
    assert np.abs(last.x - same.x).max() < STILL * SPEED * left
    assert np.abs(last.F - same.F).max() < 0.1
    assert (last.d == same.d).all()
    assert any("settled at frame" in w for w in early.report.summary()["warnings"])


def test_what_holds_or_rings_does_not_settle() -> None:
    for simulator in (pulled("settled", crit=9.9), pulled("settled", damping="none", projection=0.0)):
        for _ in simulator.frames():
            pass
        assert simulator.report.settled_frame is None


def test_updated_cannot_settle() -> None:
    with pytest.raises(ValueError, match=r"solver\.until=settled needs fragments"):
        Solver(formulation="updated", until="settled")


def test_nothing_left_is_settled() -> None:
    simulator = pulled("settled")
    frames = simulator.frames()
    next(frames)
    simulator.state.points.D.from_numpy(np.ones(simulator.state.n, np.float32))
    for _ in frames:
        pass
    assert simulator.report.settled_frame == 2  # parted in frame 1
