"""The codec of maps against its inverse."""

import numpy as np
import pytest

from fracsim import codec


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
