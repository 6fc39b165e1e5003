"""Physics maps, each against its defining equation."""

from pathlib import Path

import numpy as np
import pytest

from fracsim import maps, registry
from fracsim.maps import damage, flow, strain, stress
from fracsim.records import Array, Frame

FRONT = np.diag([1.0, -1.0, -1.0])
"""Rows: right, down and ahead of a camera that looks along -z with y up."""


def frame(F: Array, tau: Array | None = None, v: Array | None = None, d: Array | None = None) -> Frame:
    n = len(F)
    zeros = np.zeros((n, 3))
    return Frame(0, 0.0, zeros, zeros if v is None else v, F, np.zeros((n, 3, 3)) if tau is None else tau,
                 np.zeros(n) if d is None else d)  # fmt: skip


def rotations(n: int, seed: int) -> Array:
    Q, R = np.linalg.qr(np.random.default_rng(seed).standard_normal((n, 3, 3)))
    Q *= np.sign(np.diagonal(R, axis1=1, axis2=2))[:, None, :]
    Q[:, :, 0] *= np.linalg.det(Q)[:, None]
    return Q


@pytest.mark.parametrize("name", registry.names("fracsim.maps"))
def test_every_map_follows_the_interface(name: str) -> None:
    module = registry.load("fracsim.maps", name, "capture.maps")
    rng = np.random.default_rng(0)
    F = (np.eye(3) + 0.2 * rng.standard_normal((50, 3, 3))).astype(np.float32)
    tau = rng.standard_normal((50, 3, 3)).astype(np.float32)
    state = frame(F, tau + tau.swapaxes(1, 2), rng.standard_normal((50, 3)).astype(np.float32), rng.random(50))
    q = module.quantity(state, FRONT)
    assert q.shape == (50, module.CHANNELS)
    assert np.isfinite(q).all()
    assert module.UNIT
    assert module.LABEL
    assert module.SCALE is None or module.SCALE > 0


@pytest.mark.parametrize("name", registry.names("fracsim.maps"))
def test_every_map_is_zero_at_rest(name: str) -> None:
    module = registry.load("fracsim.maps", name, "capture.maps")
    assert (module.quantity(frame(np.tile(np.eye(3), (4, 1, 1))), FRONT) == 0).all()


def test_strain_is_the_norm_of_green_lagrange() -> None:
    F = np.eye(3) + 0.5 * np.random.default_rng(1).standard_normal((200, 3, 3))
    E = 0.5 * (F.swapaxes(1, 2) @ F - np.eye(3))
    np.testing.assert_allclose(strain.quantity(frame(F), FRONT)[:, 0], np.linalg.norm(E, axis=(1, 2)), rtol=1e-12)


def test_strain_of_uniaxial_stretch_in_any_orientation() -> None:
    # F = R diag(2, 1, 1): E = diag(3/2, 0, 0) whatever the rotation R.
    R = rotations(20, seed=2)
    np.testing.assert_allclose(strain.quantity(frame(R @ np.diag([2.0, 1, 1])), FRONT), 1.5, rtol=1e-12)


def test_small_strain_survives_single_precision() -> None:
    # The rounding of 1 + 2 e to float32 is 6e-8, so e = 1e-4 keeps three digits.
    F = np.diag([1 + 1e-4, 1, 1]).astype(np.float32)[None]
    np.testing.assert_allclose(strain.quantity(frame(F), FRONT), 1e-4, rtol=2e-3)


def test_stress_of_uniaxial_tension_and_of_shear() -> None:
    # Von Mises: |sigma| in uniaxial tension, sqrt(3) |tau| in pure shear; the Cauchy stress is tau / J.
    F = np.tile(np.diag([2.0, 1, 1]), (2, 1, 1))
    tau = np.zeros((2, 3, 3))
    tau[0, 0, 0] = 600.0
    tau[1, 0, 1] = tau[1, 1, 0] = 600.0
    np.testing.assert_allclose(stress.quantity(frame(F, tau), FRONT)[:, 0], [300, 300 * np.sqrt(3)], rtol=1e-12)


def test_stress_is_the_deviatoric_measure() -> None:
    rng = np.random.default_rng(3)
    F = np.eye(3) + 0.3 * rng.standard_normal((200, 3, 3))
    F = F[np.linalg.det(F) > stress.J_MIN]
    tau = rng.standard_normal((len(F), 3, 3))
    tau += tau.swapaxes(1, 2)
    sigma = tau / np.linalg.det(F)[:, None, None]
    s = sigma - np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    expected = np.sqrt(1.5 * (s**2).sum(axis=(1, 2)))
    np.testing.assert_allclose(stress.quantity(frame(F, tau), FRONT)[:, 0], expected, rtol=1e-10)


def test_pressure_carries_no_von_mises_stress() -> None:
    tau = np.tile(1e6 * np.eye(3), (1, 1, 1))
    assert stress.quantity(frame(np.eye(3)[None], tau), FRONT)[0, 0] == 0


def test_failed_and_flattened_material_has_no_stress() -> None:
    flat = np.diag([2.0, 1.0, 0.0])[None]
    assert stress.quantity(frame(flat), FRONT)[0, 0] == 0


@pytest.mark.parametrize("J", [0.05, 1e-3, 1e-30, 0.0, -0.3])
def test_crushed_material_shows_the_stress_at_the_smallest_volume_ratio_of_the_laws(J: float) -> None:
    """tau / J would be 600 kPa, 600 GPa, ... and 0 / 0: a law takes J for 0.05 there, and so does the map."""
    tensor = pytest.importorskip("fracsim.tensor")
    assert stress.J_MIN == tensor.J_MIN
    tau = np.zeros((1, 3, 3))
    tau[0, 0, 0] = 600.0
    for dtype in (np.float64, np.float32):
        F = np.diag([1.0, 1, J])[None].astype(dtype)
        got = stress.quantity(frame(F, tau.astype(dtype)), FRONT)
        np.testing.assert_allclose(got, 600 / 0.05, rtol=1e-6)
        assert got.dtype == dtype
        np.testing.assert_allclose(frame(F, tau.astype(dtype)).stress[0, 0, 0], 600 / 0.05, rtol=1e-6)


def test_damage_is_passed_on() -> None:
    d = np.array([0.0, 0.25, 1.0])
    assert (damage.quantity(frame(np.tile(np.eye(3), (3, 1, 1)), d=d), FRONT)[:, 0] == d).all()


def test_flow_is_right_and_up_in_the_picture() -> None:
    eye = np.tile(np.eye(3), (3, 1, 1))
    v = np.eye(3)
    assert (flow.quantity(frame(eye, v=v), FRONT) == [[1, 0], [0, 1], [0, 0]]).all()
    # From the right, azimuth 90 degrees: the picture's right is -z, x comes towards the eye.
    side = np.array([[0, 0, -1.0], [0, -1, 0], [-1, 0, 0]])
    assert (flow.quantity(frame(eye, v=v), side) == [[0, 0], [0, 1], [-1, 0]]).all()


def test_a_map_that_is_not_one_is_named(tmp_path: Path) -> None:
    """A module without CHANNELS, and a quantity of shape (N,), would fail later in words of NumPy."""
    file = tmp_path / "heat.py"
    half = 'UNIT, LABEL, SCALE = "1", "heat", None\ndef quantity(frame, camera_axes):\n    return frame.d\n'
    file.write_text(half)
    with pytest.raises(ValueError, match=r"capture\.maps=.*heat\.py lacks CHANNELS"):
        maps.load(str(file))
    file.write_text(f"CHANNELS = 1\n{half}")
    still = frame(np.tile(np.eye(3), (3, 1, 1)), d=np.zeros(3))
    with pytest.raises(ValueError, match=r"heat\.py returns shape \(3,\), expected \(3, 1\)"):
        maps.values("heat", maps.load(str(file)), still, FRONT)
