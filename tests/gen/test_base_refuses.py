"""A checkpoint that does not fit is refused with the fields or tensors that differ, and the way out."""

import json

import pytest
import torch
from safetensors.torch import load_file, save_file

from fracgen.model import build
from fracgen.model.files import STEM
from fracgen.model.write import save_released

from .networks import small


@pytest.fixture
def folder(tmp_path):
    """A small checkpoint in released layout."""
    save_released(build(small(), ["rgb"]), tmp_path)
    return tmp_path


def refusal(folder, **changes) -> str:
    """What is said when the transformer is built from `folder`."""
    with pytest.raises(ValueError, match=r"model\.path") as caught:
        build(small(path=str(folder), **changes), ["rgb"])
    return str(caught.value)


def edit(folder, change) -> None:
    """Write the checkpoint again with its tensors changed."""
    file = folder / f"{STEM}.safetensors"
    tensors = {name: value.clone() for name, value in load_file(file).items()}
    change(tensors)
    save_file(tensors, file)


def test_sizes_that_differ_from_config_json_are_named_with_both_values(folder):
    said = refusal(folder, layers=3, heads=3, ffn_dim=65)
    for part in ("model.layers=3, but num_layers=2: set model.layers=2", "model.heads=3, but num_heads=2",
                 "model.ffn_dim=65, but ffn_dim=64"):  # fmt: skip
        assert part in said
    assert "head_dim" not in said


def test_sizes_in_the_config_json_of_diffusers_are_checked_too(tmp_path):
    build(small(image_dim=0), ["rgb"]).save_pretrained(tmp_path)
    assert "model.image_dim=32, but image_dim=0" in refusal(tmp_path)
    assert "model.head_dim=26, but attention_head_dim=24" in refusal(tmp_path, image_dim=0, head_dim=26)


def test_missing_extra_and_misshapen_tensors_are_named_in_one_error(folder):
    def change(tensors):
        del tensors["blocks.1.ffn.2.bias"]
        tensors["head.head.bias"] = torch.zeros(3)
        tensors |= {f"vace_blocks.{n}.weight": torch.zeros(1) for n in range(9)}

    edit(folder, change)
    said = refusal(folder)
    assert "1 missing: blocks.1.ffn.net.2.bias" in said
    assert "9 extra: vace_blocks.0.weight, " in said
    assert "vace_blocks.4.weight, ..." in said
    assert "1 misshapen: proj_out.bias (3,) for (64,)" in said


def test_without_config_json_the_shapes_of_tensors_tell(folder):
    (folder / "config.json").unlink()
    assert "misshapen: blocks.0.ffn.net.0.proj.bias (64,) for (65,)" in refusal(folder, ffn_dim=65)
    assert "extra: blocks.1." in refusal(folder, layers=1)


def test_a_checkpoint_without_ref_conv_is_refused_with_the_reason(folder):
    edit(folder, lambda tensors: [tensors.pop(f"ref_conv.{leaf}") for leaf in ("weight", "bias")])
    assert "no ref_conv, which reads the reference picture, so it is not Wan2.1-Fun-V1.1-Control" in refusal(folder)


def test_a_file_that_is_cut_off_is_named(folder):
    file = folder / f"{STEM}.safetensors"
    file.write_bytes(file.read_bytes()[:-100])
    assert f"{file} cannot be read" in refusal(folder)
    (folder / "config.json").write_text("{")
    assert "config.json cannot be read" in refusal(folder)


def test_a_folder_that_is_missing_or_empty_is_named(tmp_path):
    assert "none is no folder: give the folder" in refusal(tmp_path / "none")
    (tmp_path / "readme.txt").touch()
    assert "holds readme.txt, but no weights: needed is" in refusal(tmp_path)


def test_shards_that_are_missing_are_counted(tmp_path):
    build(small(), ["rgb"]).save_pretrained(tmp_path, max_shard_size="50KB")
    shards = sorted(tmp_path.glob("*.safetensors"))
    shards[1].unlink()
    assert f"1 of {len(shards)} shards are missing in {tmp_path}, as {shards[1].name}" in refusal(tmp_path)
    index = tmp_path / f"{STEM}.safetensors.index.json"
    index.write_text(json.dumps([]))
    assert "index.json cannot be read" in refusal(tmp_path)


def test_a_name_that_the_hub_does_not_give_is_refused_with_the_reason(monkeypatch):
    def offline(*_, **__):
        raise ConnectionError("no route")

    monkeypatch.setattr("huggingface_hub.snapshot_download", offline)
    with pytest.raises(
        ValueError, match=r"model\.path=a/b cannot be fetched .*ConnectionError: no route.*model\.hub=f"
    ):
        build(small(path="a/b", hub=True), ["rgb"])


def test_weights_on_the_hub_are_those_of_its_local_copy(folder, monkeypatch):
    monkeypatch.setattr("huggingface_hub.snapshot_download", lambda name, allow_patterns: str(folder))
    network = build(small(path="a/b", hub=True), ["rgb"])
    assert torch.equal(network.ref_conv.weight, build(small(), ["rgb"]).ref_conv.weight)


def test_adapters_have_no_place_in_the_released_layout(tmp_path):
    from peft import LoraConfig

    network = build(small(), ["rgb"])
    network.add_adapter(LoraConfig(r=2, target_modules=["to_q"]))
    with pytest.raises(ValueError, match="has adapters"):
        save_released(network, tmp_path)
