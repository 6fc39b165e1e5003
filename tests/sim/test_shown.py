"""What a frame shows is never stretched beyond lambda_crit: by F, by the Gaussian, by strain and stress."""

from pathlib import Path

import numpy as np
import pytest

from fracsim import Capture, Fracture, Loading, Material, Scene, Solver, compose
from fracsim.asset import ply
from fracsim.asset.build import build
from fracsim.maps import strain
from fracsim.records import Array
from fracsim.render.film import Film
from fracsim.solve.shown import capped
from fracsim.solve.simulator import Simulator

from .bars import bar, scene

TOLERANCE = 1e-5
"""F is float32: an ulp of a stretch of 3 is 8e-8 of it, and the largest singular value adds up nine entries."""
TORN = ("solver.cells=40", "loading.speed=4", "capture.frames=9", "capture.fps=100", "backend.threads=1")
KINDS = {
    "bread": (),
    "duck, rubber": ("asset=duck", "material=rubber", "fracture.onset=1.8", "fracture.crit=2.2"),
    "bear at an angle": ("asset=bear", "loading.axis_deg=30", "loading.offset=0.15"),
    "sliding": ("asset=croissant", "loading.grips=sliding"),
    "soft": ("loading=soft", "asset=bar"),
    "nothing fails at grips": ("asset=bar", "loading.offset=0.05", "loading.speed=3"),
    "updated": ("solver=updated",),
    "updated, rubber": ("solver=updated", "asset=bar", "material=rubber"),
}


def stretches(F: Array) -> Array:
    """Largest stretches, (N,)."""
    return np.asarray(np.linalg.norm(F.astype(np.float64), ord=2, axis=(1, 2)))


def test_a_cap_keeps_the_rotation_and_the_other_stretches() -> None:
    rng = np.random.default_rng(0)
    U, V = (np.linalg.qr(rng.normal(size=(50, 3, 3)))[0] for _ in range(2))
    l = rng.uniform(0.2, 5, size=(50, 3))
    F, beyond = capped((U * l[:, None]) @ V, 2.5, l.max(axis=1))
    assert F == pytest.approx((U * np.minimum(l, 2.5)[:, None]) @ V, abs=1e-12)
    assert (beyond == (l > 2.5).any(axis=1)).all()


def test_what_no_stretch_exceeds_is_not_touched() -> None:
    F = np.tile(np.diag([2.0, 1.9, 0.1]), (4, 1, 1))  # |F| > 2, no stretch is
    out, beyond = capped(F, 2.0, np.full(4, 2.0))
    assert out is F
    assert not beyond.any()


@pytest.mark.parametrize("kind", KINDS)
def test_no_frame_shows_a_stretch_beyond_lambda_crit(kind: str) -> None:
    s = compose(*TORN, *KINDS[kind])
    simulator = Simulator(s, build(s.asset, s.solver.spacing, s.seed))
    crit = simulator.state.medium.fracture.crit
    # |E| of three stretches of at most lambda_crit; the stretches of F are within TOLERANCE.
    most = np.sqrt(3) / 2 * (crit**2 - 1)
    for frame in simulator.frames():
        assert stretches(frame.F).max() <= crit * (1 + TOLERANCE)
        assert strain.quantity(frame, np.eye(3)).max() <= most * (1 + 4 * TOLERANCE)


def overstretched(crit: float) -> tuple[Scene, Simulator]:
    """A bar of which an exempt particle, a free one beside it and a failed one are stretched to 4 by hand."""
    s = scene(
        material=Material(law="neo_hookean", E=2e4, nu=0.3),
        fracture=Fracture(onset=crit - 0.5, crit=crit),
        loading=Loading(offset=0.15, thickness=0.05),
        solver=Solver(cells=50, pressure="particle"),
        capture=Capture(frames=1),
    )
    simulator = Simulator(s, bar(s.solver))
    state = simulator.state
    held = np.flatnonzero(state.side > 0)
    F, D = np.tile(np.eye(3, dtype=state.dtype), (state.n, 1, 1)), np.zeros(state.n, state.dtype)
    F[held] = np.diag([4.0, 0.5, 0.5])
    D[np.flatnonzero((state.side == 0) & (state.X0[:, 0] > 0.175) & (state.X0[:, 0] < 0.22))] = 1
    state.points.F.from_numpy(F)
    state.points.D.from_numpy(D)
    return s, simulator


def test_exempt_material_is_shown_at_lambda_crit_with_the_stress_of_that() -> None:
    s, simulator = overstretched(3.0)
    held = simulator.state.side > 0
    frame = next(simulator.frames())
    assert frame.F[held] == pytest.approx(np.tile(np.diag([3, 0.5, 0.5]), (held.sum(), 1, 1)), abs=1e-6)
    mu, lam = s.material.mu, s.material.lam
    # tau = mu (F F^T - I) + lam ln J I, in float32.
    expected = mu * (np.diag([9, 0.25, 0.25]) - np.eye(3)) + lam * np.log(0.75) * np.eye(3)
    assert frame.tau[held] == pytest.approx(np.tile(expected, (held.sum(), 1, 1)), rel=1e-5, abs=1e-5 * mu)
    assert simulator.report.summary()["shown_capped"] == held.sum()
    # The simulation knows no cap.
    assert simulator.state.points.F.to_numpy()[held, 0, 0] == pytest.approx(4)


def test_failed_particles_that_ride_on_exempt_ones_are_capped_too() -> None:
    _, simulator = overstretched(3.0)
    frame = next(simulator.frames())
    assert frame.failed.any()
    assert stretches(frame.F[frame.failed]).max() > 2.5  # they ride on held ones, stretched to 4
    assert stretches(frame.F).max() <= 3 * (1 + TOLERANCE)


def neck(path: Path) -> None:
    """A dumb-bell of trained Gaussians: two balls and a thin neck of long ones."""
    rng = np.random.default_rng(1)
    way = rng.normal(size=(3000, 3))
    ball = 0.25 * way / np.linalg.norm(way, axis=1, keepdims=True)
    ball[:, 0] += np.where(np.arange(3000) % 2, 0.5, -0.5)
    angle, along = rng.uniform(0, 2 * np.pi, 1500), rng.uniform(-0.4, 0.4, 1500)
    thin = np.stack([along, 0.05 * np.cos(angle), 0.05 * np.sin(angle)], axis=1)
    covariance = np.concatenate([np.tile([1e-4, 0, 0, 1e-4, 0, 1e-4], (3000, 1)),
                                 np.tile([9e-4, 0, 0, 1e-5, 0, 1e-5], (1500, 1))])  # fmt: skip
    sh = np.zeros((4500, 1, 3))
    ply.write(path, np.concatenate([ball, thin]), covariance, np.full(4500, 0.9), sh)


def test_a_splat_with_a_thin_neck_has_no_needles(tmp_path: Path) -> None:
    """No Gaussian gets longer than its rest size times lambda_crit, before and after it tears."""
    neck(tmp_path / "neck.ply")
    pull = ("asset=ply", f"asset.path={tmp_path / 'neck.ply'}", "loading.offset=0.15", "loading.speed=3")
    s = compose(*TORN, *pull, "material=rubber", "fracture=rubber", "capture.frames=12")
    simulator = Simulator(s, build(s.asset, s.solver.spacing, s.seed))
    body = simulator.particles
    rest = np.linalg.eigvalsh(matrices(body.covariance))[:, -1]
    crit = simulator.state.medium.fracture.crit
    longest = 1.0
    for frame in simulator.frames():
        size = np.linalg.eigvalsh(matrices(Film.gaussians(frame, body)[1]))[:, -1]
        longest = max(longest, float(np.sqrt(size / rest).max()))
    assert longest <= crit * (1 + TOLERANCE)
    assert longest > 0.8 * crit  # the pull does go as far
    assert simulator.report.break_frame is not None


def matrices(covariance: Array) -> Array:
    """Covariances xx, xy, xz, yy, yz, zz, (N, 6), as (N, 3, 3) float64."""
    return np.asarray(covariance.astype(np.float64)[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3))
