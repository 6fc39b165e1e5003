"""The sizes in conf/model: the released model, and one of the same classes for a laptop."""

import dataclasses
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from fracgen.config.model import Model
from fracgen.layout import STREAMS
from fracgen.model import build, empty

CONF = Path(__file__).parents[2] / "conf" / "model"


def configured(file: Path) -> Model:
    """The section of the config that a file of conf/model gives."""
    merged = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(Model), OmegaConf.load(file)))
    assert isinstance(merged, Model)
    return merged


@pytest.mark.parametrize("file", sorted(CONF.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_choice_is_a_model(file):
    assert empty(configured(file), STREAMS).streams == STREAMS


def test_the_released_sizes_are_the_default():
    assert dataclasses.asdict(configured(CONF / "fun_1_3b.yaml")) == dataclasses.asdict(Model())


def test_the_tiny_model_computes_from_random_weights():
    network = build(configured(CONF / "tiny.yaml"), ["rgb"])
    assert sum(p.numel() for p in network.parameters()) < 3e6
    with torch.no_grad():
        (out,) = network(torch.randn(1, 48, 2, 4, 4), torch.tensor([500.0]), torch.zeros(1, 512, 64), return_dict=False)
    assert 0.01 < out.std() < 2  # a velocity has a standard deviation near 1.4: it begins at its scale or below
