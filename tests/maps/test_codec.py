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
    # colours, eps = 6e-8 times the steepest arc of the wheel, 15/54 of a turn.
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


def original(u: float, v: float) -> list[float]:
    """The colour of Baker et al. 2011 for a flow (right, down) of length 1, in 0..255, colour by colour."""
    arcs = ((15, 0, 1, 1), (6, 1, 0, -1), (4, 1, 2, 1), (11, 2, 1, -1), (13, 2, 0, 1), (6, 0, 2, -1))
    wheel = []
    for steps, full, moving, sign in arcs:
        for k in range(steps):
            colour = [0, 0, 0]
            colour[full] = 255
            colour[moving] = 255 * k // steps if sign > 0 else 255 - 255 * k // steps
            wheel.append(colour)
    position = (np.arctan2(-v, -u) / np.pi + 1) / 2 * (len(wheel) - 1)
    k = int(position)
    first, second = wheel[k], wheel[(k + 1) % len(wheel)]
    return [(1 - (position - k)) * a + (position - k) * b for a, b in zip(first, second, strict=True)]


def test_colours_are_the_original_ones() -> None:
    """Every degree but the seam, to the level that the original drops by its integers."""
    for degree in range(1, 360):
        u, v = np.cos(np.radians(degree)), np.sin(np.radians(degree))
        (ours,) = 255 * codec.encode(np.array([[u, -v]]), 1.0)
        np.testing.assert_allclose(ours, original(u, v), atol=1.0, err_msg=str(degree))


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_colours_of_the_four_axes(zero: float) -> None:
    """Right, down, left and up, from the original with a positive zero; right lies at the seam and is red."""
    axes = {(1.0, zero): (255, 0, 0), (zero, -1.0): original(0, 1), (-1.0, zero): original(-1, 0.0),
            (zero, 1.0): original(0, -1)}  # fmt: skip
    for (right, up), colour in axes.items():
        np.testing.assert_allclose(255 * codec.encode(np.array([right, up]), 1.0), colour, atol=1.0)


def test_both_sides_of_the_seam_are_image_right() -> None:
    """The last colour, and those between it and red that only noise makes, decode to a whole turn or none."""
    for blue in (0.0, 20.0, 42.5):
        decoded = codec.decode(np.array([255.0, 0, blue]) / 255, 1.0, 2)
        np.testing.assert_allclose(decoded, [1, 0], atol=1e-6)


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
