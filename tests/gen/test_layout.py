"""The joint latent: streams one below the other, in the order of the paper; cutting is the inverse of joining."""

import itertools

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from fracgen import layout

SUBSETS = [("rgb", *maps) for n in range(5) for maps in itertools.combinations(layout.MAPS, n)]


def latents(streams: tuple[str, ...]) -> dict[str, Tensor]:
    """A latent [2, 16, 3, 4, 6] a stream, all numbers different."""
    numbers = torch.arange(len(streams) * 2 * 16 * 3 * 4 * 6, dtype=torch.float32)
    return dict(zip(streams, numbers.reshape(len(streams), 2, 16, 3, 4, 6), strict=True))


@pytest.mark.parametrize("streams", SUBSETS)
def test_split_is_the_inverse_of_join(streams: tuple[str, ...]) -> None:
    parts = latents(streams)
    joint = layout.join(parts)
    assert joint.shape == (2, 16, 3, 4 * len(streams), 6)
    back = layout.split(joint, streams)
    assert list(back) == list(streams)
    assert all(torch.equal(back[name], parts[name]) for name in streams)
    assert torch.equal(layout.join(back), joint)


def test_split_gives_views() -> None:
    joint = layout.join(latents(layout.STREAMS))
    layout.split(joint, layout.STREAMS)["stress"].zero_()
    assert not joint[..., 12:16, :].any()
    assert joint[..., :12, :].any()


def test_streams_have_the_order_of_the_paper_whatever_order_they_are_named_in() -> None:
    """Colour on top, then flow, strain, stress, damage."""
    assert layout.STREAMS == ("rgb", "flow", "strain", "stress", "damage")
    parts = latents(layout.STREAMS)
    shuffled = {name: parts[name] for name in ("damage", "rgb", "stress", "flow", "strain")}
    assert torch.equal(layout.join(shuffled), torch.cat([parts[name] for name in layout.STREAMS], dim=-2))
    assert layout.ordered(["damage", "rgb"]) == ("rgb", "damage")


@pytest.mark.parametrize("streams", [["flow"], ["rgb", "rgb"], ["rgb", "depth"], []])
def test_streams_without_colour_or_double_or_unknown_are_refused(streams: list[str]) -> None:
    with pytest.raises(ValueError, match=r"streams=\[.*\] is not allowed: name rgb, and any of flow, strain"):
        layout.ordered(streams)


@given(st.integers(0, 100))
def test_frames_are_one_and_groups_of_four(n: int) -> None:
    assert layout.latent_frames(1 + 4 * n) == 1 + n


@given(st.integers(-10, 400).filter(lambda n: n < 1 or n % 4 != 1))
def test_other_numbers_of_frames_are_refused_with_the_neighbours(frames: int) -> None:
    with pytest.raises(ValueError, match=rf"frames={frames} must be 1 \+ 4 n") as error:
        layout.latent_frames(frames)
    named = [int(word.strip(".")) for word in str(error.value).partition("set frames=")[2].split(" or ")]
    assert all(layout.latent_frames(n) for n in named)
    assert frames < 1 or named[0] < frames < named[1]


def test_81_frames_of_512_pixels_are_21_by_64_by_64() -> None:
    assert layout.latent_frames(81) == 21
    assert layout.latent_size(512, 512) == (64, 64)
    assert layout.latent_size(832, 480) == (104, 60)


@pytest.mark.parametrize(("width", "height", "named"), [(500, 512, "width"), (512, 8, "height"), (512, 0, "height"),
                                                        (-16, 512, "width")])  # fmt: skip
def test_pictures_whose_tokens_would_straddle_two_maps_are_refused(width: int, height: int, named: str) -> None:
    with pytest.raises(ValueError, match=rf"{named}=.* must be a positive multiple of 16"):
        layout.latent_size(width, height)


def test_the_reference_stands_beside_colour_and_zeros_beside_the_maps() -> None:
    reference = torch.rand(2, 16, 4, 6) + 1
    padded = layout.pad_reference(reference, 5)
    assert padded.shape == (2, 16, 20, 6)
    assert torch.equal(padded[..., :4, :], reference)
    assert not padded[..., 4:, :].any()
    assert torch.equal(layout.pad_reference(reference, 1), reference)
