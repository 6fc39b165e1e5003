"""Physics maps: each against its defining equation, and the codec against its inverse."""

import numpy as np
import pytest

from fracsim import codec, registry
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
    tau = rng.standard_normal((200, 3, 3))
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


@pytest.mark.parametrize("scale", [1.0, 5e3])
def test_codec_returns_scalars(scale: float) -> None:
    raw = scale * np.random.default_rng(4).random((3, 8, 8, 1)).astype(np.float32)
    video = codec.encode(raw, scale)
    assert video.shape == (3, 8, 8, 3)
    assert (video[..., :1] == video).all()
    np.testing.assert_allclose(codec.decode(video, scale, 1), raw, rtol=1e-6)


def test_codec_returns_vectors_in_all_directions() -> None:
    angle = np.linspace(-np.pi, np.pi, 7201)
    raw = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * np.linspace(0.01, 2, 7201)[:, None]
    video = codec.encode(raw, 2.0)
    # The magnitude is the largest colour, the hue is inverted piece by piece; what is left is float32 rounding of
    # colours, eps = 6e-8 times the steepest arc of the wheel, 15/55 of a turn.
    np.testing.assert_allclose(video.max(axis=-1), np.linspace(0.005, 1, 7201), rtol=1e-6)
    np.testing.assert_allclose(codec.decode(video, 2.0, 2), raw, atol=2e-6)


def test_codec_does_not_depend_on_the_sign_of_zero() -> None:
    # arctan2 puts (-1, -0.0) and (-1, 0.0) a whole turn apart; both are the same direction and the same colour.
    for x in (1.0, -1.0):
        plus, minus = codec.encode(np.array([[x, 0.0], [x, -0.0]]), 1.0)
        np.testing.assert_allclose(plus, minus, atol=1e-7)
    np.testing.assert_allclose(codec.encode(np.array([1.0, 0.0]), 1.0), [1, 0, 0], atol=1e-7)  # right is red
    np.testing.assert_allclose(codec.encode(np.array([1.0, 1e-30]), 1.0), [1, 0, 0], atol=1e-7)
    np.testing.assert_allclose(codec.encode(np.array([1.0, -1e-30]), 1.0), [1, 0, 0], atol=1e-7)


@pytest.mark.parametrize("channels", [1, 2])
def test_codec_keeps_zero_black_and_clips(channels: int) -> None:
    zero = np.zeros((2, 2, channels), np.float32)
    assert (codec.encode(zero, 3.0) == 0).all()
    assert (codec.decode(codec.encode(zero, 3.0), 3.0, channels) == 0).all()
    assert codec.encode(zero + 100, 3.0).max() == pytest.approx(1)


def test_scale_of_a_clip_ignores_the_background() -> None:
    raw = np.zeros((2, 10, 10, 2))
    raw[0, 0, 0] = (3, 4)
    raw[1, 0, :5] = (0.6, 0.8)
    assert codec.scale(raw) == pytest.approx(5)
    assert codec.scale(raw, 50) == pytest.approx(1)
    assert codec.scale(np.zeros((1, 4, 4, 1))) == 1


def test_codec_refuses_what_it_cannot_show() -> None:
    with pytest.raises(ValueError, match=r"scale=0.*positive"):
        codec.encode(np.zeros((2, 2, 1)), 0.0)
    with pytest.raises(ValueError, match=r"channels=3"):
        codec.encode(np.zeros((2, 2, 3)), 1.0)
