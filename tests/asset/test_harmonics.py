"""Turned spherical harmonics show in the turned direction what they showed before."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fracsim.asset.harmonics import basis, turned


@pytest.mark.parametrize("k", [1, 4, 9, 16])
def test_each_gaussian_turns_by_its_own_rotation(k: int) -> None:
    rng = np.random.default_rng(0)
    sh, R = rng.normal(size=(30, k, 3)), Rotation.from_quat(rng.normal(size=(30, 4))).as_matrix()
    d = rng.normal(size=(5, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    before = np.einsum("mk,nkc->nmc", basis(d)[:, :k], sh)
    new = turned(sh, R)
    after = np.stack([basis(d @ R[n].T)[:, :k] @ new[n] for n in range(30)])
    assert np.abs(after - before).max() < 1e-12
    assert np.abs(turned(sh, R[0])[0] - new[0]).max() < 1e-12
