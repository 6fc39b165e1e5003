"""Base weights: random ones follow the seed alone; those of a checkpoint come back bit for bit, in both layouts."""

import re

import pytest
import torch

from fracgen.config.model import Model
from fracgen.layout import STREAMS
from fracgen.model import base_identity, build
from fracgen.model.files import STEM
from fracgen.model.write import save_released

from .networks import inputs, run, small


def test_random_weights_follow_the_seed_and_neither_streams_nor_rope_nor_the_process():
    one = build(small(), ["rgb"]).state_dict()
    before = torch.random.get_rng_state()
    five = build(small(rope="shared"), STREAMS).state_dict()
    assert torch.equal(before, torch.random.get_rng_state())
    assert five.keys() - one.keys() == {"map_embed"}
    assert all(torch.equal(one[name], five[name]) for name in one)
    assert not torch.equal(build(small(seed=1), ["rgb"]).ref_conv.weight, one["ref_conv.weight"])


def test_norms_modulation_and_embedding_of_the_timestep_stay_float32():
    network = build(small(rope="shared"), ["rgb"], dtype=torch.bfloat16)
    islands = re.compile(r"scale_shift_table|time_embedder|\.norm[123]\.|map_embed")
    for name, value in network.state_dict().items():
        assert value.dtype == (torch.float32 if islands.search(name) else torch.bfloat16), name
    assert network.rope.freqs_cos.dtype == torch.float32
    assert all(p.requires_grad for p in network.parameters())
    assert not network.training


def written(layout: str, folder, cfg: Model, dtype: torch.dtype) -> None:
    """Random weights of `cfg` as a checkpoint."""
    network = build(cfg, ["rgb"], dtype=dtype)
    if layout == "released":
        save_released(network, folder)
    elif layout == "diffusers":
        network.save_pretrained(folder)
    else:
        network.save_pretrained(folder / "transformer", max_shard_size="50KB")
        assert len(list((folder / "transformer").glob("*.safetensors"))) > 2


@pytest.mark.parametrize("image_dim", [32, 0])
@pytest.mark.parametrize("layout", ["released", "diffusers", "diffusers in shards"])
def test_a_checkpoint_gives_the_velocity_of_what_was_saved_bit_for_bit(layout, image_dim, tmp_path):
    written(layout, tmp_path, small(image_dim=image_dim), torch.float32)
    call = inputs(streams=2, image=image_dim > 0)
    for dtype in (torch.float32, torch.bfloat16):
        before = build(small(image_dim=image_dim), ["rgb", "flow"], dtype=dtype)
        after = build(small(image_dim=image_dim, path=str(tmp_path)), ["rgb", "flow"], dtype=dtype)
        assert torch.equal(run(after, call), run(before, call))
        types = [{name: value.dtype for name, value in n.state_dict().items()} for n in (before, after)]
        assert types[0] == types[1]


def test_a_checkpoint_of_the_base_gets_an_embedding_of_maps_that_is_zero(tmp_path):
    written("released", tmp_path, small(), torch.float32)
    network = build(small(path=str(tmp_path), rope="shared"), ["rgb", "flow"])
    assert network.map_embed.shape == (5, 48)
    assert not network.map_embed.any()


def test_weights_that_are_mapped_from_a_file_can_be_trained_without_changing_it(tmp_path):
    written("released", tmp_path, small(), torch.float32)
    cfg = small(path=str(tmp_path))
    network, content = build(cfg, ["rgb"]), (tmp_path / f"{STEM}.safetensors").read_bytes()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(1.0)
    assert (tmp_path / f"{STEM}.safetensors").read_bytes() == content


def test_the_identity_of_a_base_is_that_of_its_weights(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        written("released", tmp_path / name, small(seed=seed), torch.float32)
    a, b, c = (base_identity(small(path=str(tmp_path / name))) for name in "abc")
    assert re.fullmatch("[0-9a-f]{12}", a)
    assert a == b != c
    (tmp_path / "a" / f"{STEM}.safetensors").write_bytes((tmp_path / "c" / f"{STEM}.safetensors").read_bytes())
    assert base_identity(small(path=str(tmp_path / "a"))) == c


def test_the_identity_of_random_weights_is_that_of_seed_and_sizes():
    one = base_identity(small())
    assert re.fullmatch("random-0-[0-9a-f]{12}", one)
    assert one == base_identity(small(rope="shared", train="full"))
    assert one != base_identity(small(ffn_dim=65))
    assert base_identity(small(seed=7)).startswith("random-7-")


def test_nothing_half_written_is_taken_for_a_checkpoint(tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError("no space")

    monkeypatch.setattr("fracgen.model.write.os.replace", full)
    with pytest.raises(OSError, match="no space"):
        save_released(build(small(), ["rgb"]), tmp_path)
    with pytest.raises(ValueError, match="no weights"):
        build(small(path=str(tmp_path)), ["rgb"])
