"""Checkpoints of a ball of Gaussians, for tests."""

import numpy as np

from fracsim.asset import gaussians, ply, splat
from fracsim.scene.vocab import Asset

SPACING = 0.02


def ball(n=6000, k=1, seed=0, radius=1.5, centre=(4.0, -2.0, 7.0)):
    """Gaussians on a sphere (Fibonacci points), flat along it, red above and blue below; covariance (N, 6)."""
    rng = np.random.default_rng(seed)
    i = np.arange(n) + 0.5
    y, turn = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    N = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], axis=1)
    wide, flat = 0.6 * radius * np.sqrt(4 * np.pi / n), 0.1 * radius * np.sqrt(4 * np.pi / n)
    A = wide**2 * np.eye(3) + (flat**2 - wide**2) * N[:, :, None] * N[:, None, :]
    sh = 0.1 * rng.normal(size=(n, k, 3))
    sh[:, 0] = (np.where(y[:, None] > 0, (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)) - 0.5) / gaussians.SH_C0
    return radius * N + centre, ply.triangle(A), rng.uniform(0.5, 0.99, n), sh


def prepared(path, spacing=SPACING, **fields):
    """The particles of a checkpoint."""
    return splat.prepare(Asset(kind="ply", path=str(path), **fields), spacing, 0)
