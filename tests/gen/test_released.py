"""Names of tensors: the released checkpoint, diffusers, and this package's transformer agree on all 985."""

import json
from pathlib import Path

import pytest
import torch

from fracgen.config.model import Model
from fracgen.model import empty
from fracgen.model.released import to_diffusers, to_released

FILE = Path(__file__).parents[1] / "reference" / "wan_fun_control_1_3b.json"
"""Tensors of Wan2.1-Fun-V1.1-1.3B-Control in both layouts; the file says how it is to be read."""


def reference(layout: str) -> dict[str, tuple[int, ...]]:
    """Name to shape of all tensors in a layout."""
    content = json.loads(FILE.read_text(encoding="utf-8"))
    one = content[layout]
    blocks = {f"blocks.{n}.{k}": v for n in range(content["blocks"]) for k, v in one["block"].items()}
    return {name: tuple(shape) for name, shape in (one["outside"] | blocks).items()}


def test_the_full_model_has_the_tensors_of_the_released_one_in_both_layouts():
    shapes = {name: tuple(value.shape) for name, value in empty(Model(), ["rgb"]).state_dict().items()}
    assert len(shapes) == 985
    assert shapes == reference("diffusers")
    assert {to_released(name): shape for name, shape in shapes.items()} == reference("released")


def test_the_full_model_has_1_564_602_176_parameters():
    assert sum(p.numel() for p in empty(Model(), ["rgb"]).parameters()) == 1_564_602_176


def test_names_go_there_and_back():
    assert [to_released(to_diffusers(name)) for name in reference("released")] == list(reference("released"))
    assert {to_diffusers(name): shape for name, shape in reference("released").items()} == reference("diffusers")


def test_the_converter_of_diffusers_gives_the_same_names():
    from diffusers.loaders.single_file_utils import convert_wan_transformer_to_diffusers

    for name in reference("released"):
        assert list(convert_wan_transformer_to_diffusers({name: torch.zeros(1)})) == [to_diffusers(name)]


def test_modules_have_names_too():
    pairs = {"blocks.7.attn2.to_out.0": "blocks.7.cross_attn.o", "blocks.0.ffn.net.0.proj": "blocks.0.ffn.0"}
    assert {name: to_released(name) for name in pairs} == pairs


@pytest.mark.parametrize("name", ["map_embed", "ref_conv.weight", "patch_embedding.bias", "blocks.3.adapter.weight"])
def test_a_name_without_a_rule_stays(name):
    assert to_diffusers(name) == to_released(name) == name
