"""What has no volume rides on what has: exactly in a uniform deformation, and on its own side of a crack."""

from dataclasses import replace

import numpy as np
import pytest

from fracsim import Run, compose
from fracsim.records import Array, Frame, Particles
from fracsim.solve.riders import Riders, moved

SPACING, H = 0.01, 0.02


def block() -> Particles:
    """A cube of 8 x 8 x 8 particles and 200 riders in and on it."""
    grid = np.stack(np.meshgrid(*[np.arange(8) * SPACING] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    X = np.concatenate([grid, np.random.default_rng(0).uniform(-0.2 * SPACING, 7.2 * SPACING, (200, 3))])
    n = len(X)
    return Particles(X.astype(np.float32), np.where(np.arange(n) < 512, 1e-6, 0).astype(np.float32),
                     np.zeros((n, 6), np.float32), np.ones(n, np.float32), np.zeros((n, 1, 3), np.float32),
                     np.ones(n, bool), SPACING)  # fmt: skip


def frame(particles: Particles, A: Array, b: Array) -> Frame:
    """The moved particles under x = A X + b, with a velocity that is linear in X."""
    X = moved(particles).X
    F = np.tile(A, (len(X), 1, 1))
    return Frame(3, 0.1, X @ A.T + b, X @ A.T, F, F @ F.transpose(0, 2, 1), np.full(len(X), 0.3))


def test_a_uniform_deformation_is_that_of_the_riders_too() -> None:
    p, A, b = block(), np.array([[1.8, 0.2, 0], [0, 0.8, 0.1], [0, 0, 0.7]]), np.array([0.3, 0, 0])
    out = Riders(p, H)(frame(p, A, b), np.zeros(512, int))
    assert len(out.x) == len(out.tau) == len(p) == 712
    assert out.x == pytest.approx(p.X @ A.T + b, abs=1e-6)
    assert out.F == pytest.approx(np.tile(A, (712, 1, 1)), abs=1e-6)
    assert out.tau == pytest.approx(np.tile(A @ A.T, (712, 1, 1)), abs=1e-6)
    assert out.d == pytest.approx(0.3)


def test_beside_a_crack_each_goes_with_the_nearest_piece() -> None:
    """Two halves part by ten cells: nobody is left between them."""
    p = block()
    right = moved(p).X[:, 0] > 3.5 * SPACING
    apart = frame(p, np.eye(3), np.zeros(3))
    x = apart.x + np.where(right, 10 * H, 0)[:, None] * (1, 0, 0)
    out = Riders(p, H)(replace(apart, x=x), right.astype(int))
    shift = (out.x - p.X)[512:, 0]
    assert np.minimum(np.abs(shift), np.abs(shift - 10 * H)).max() < 1e-6
    clear = np.abs(p.X[512:, 0] - 3.5 * SPACING) > 0.5 * SPACING
    assert ((shift > 5 * H) == (p.X[512:, 0] > 3.5 * SPACING))[clear].all()


def test_riders_change_nothing_of_the_motion() -> None:
    """The same object with and without them: frames of the moved particles are equal bit for bit."""
    from fracsim.asset import build

    scene = compose("asset=bar", "solver.cells=40", "capture.frames=4", "backend.threads=1")
    plain = build.build_of(scene)
    names = ("X", "volume", "covariance", "opacity", "sh", "surface")
    more = {name: np.concatenate([getattr(plain, name), getattr(plain, name)[:50]]) for name in names}
    more["volume"][len(plain) :] = 0
    more["X"][len(plain) :] += 0.003
    run, other = Run(scene), Run(scene)
    other._object = replace(plain, **more)
    other._simulator = other._at_rest()
    for one, two in zip(run.frames(), other.frames(), strict=True):
        assert len(two.x) == len(one.x) + 50
        for name in ("x", "v", "F", "tau", "d"):
            assert np.array_equal(getattr(one, name), getattr(two, name)[: len(plain)]), name
    assert run.report.summary()["particles"] == other.report.summary()["particles"]
