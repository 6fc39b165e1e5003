"""Inputs of the transformer that do not fit are named, with what is needed."""

import pytest
import torch

from fracgen.layout import STREAMS
from fracgen.model import build

from .networks import IMAGE, inputs, run, small


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"hidden_states": torch.zeros(2, 16, 3, 20, 6)}, "hidden_states has 16 channels, 48 are needed"),
        ({"hidden_states": torch.zeros(2, 48, 3, 18, 6)}, "18 rows .* 5 times an even number"),
        ({"hidden_states": torch.zeros(2, 48, 3, 15, 6)}, "15 rows .* 5 times an even number"),
        ({"hidden_states": torch.zeros(2, 48, 3, 20, 5)}, "5 columns .* columns even"),
        ({"hidden_states": torch.zeros(1, 1).expand(2, 48, 3, 2060, 6)}, "more than 1024 tokens"),
        ({"reference": torch.zeros(2, 16, 4, 6)}, r"shape \(2, 16, 4, 6\), \(2, 16, 20, 6\) .*pad_reference"),
        ({"encoder_hidden_states": torch.zeros(2, 77, 16)}, "text has 77 tokens, 512 are needed"),
        ({"encoder_hidden_states_image": torch.zeros(2, 1, IMAGE)}, r"image has shape \(2, 1, 32\)"),
    ],
)  # fmt: skip
def test_a_shape_that_does_not_fit_is_named(change, message):
    with pytest.raises(ValueError, match=message):
        run(build(small(), STREAMS), inputs(streams=5), **change)


def test_an_image_without_a_branch_for_it_is_refused_and_any_number_of_text_tokens_is_not():
    network, call = build(small(image_dim=0), ["rgb"]), inputs(image=False)
    with pytest.raises(ValueError, match=r"no CLIP branch \(model.image_dim=0\)"):
        run(network, call, encoder_hidden_states_image=torch.zeros(2, 257, IMAGE))
    assert run(network, call, encoder_hidden_states=torch.zeros(2, 7, 16)).shape == (2, 16, 3, 4, 6)


def test_unknown_streams_are_refused():
    with pytest.raises(ValueError, match=r"streams=.*depth.*not allowed"):
        build(small(), ["rgb", "depth"])
