"""VideoMAE with the weights of a folder, here random ones of a tiny network."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fracgen.features import videomae
from tests.metrics.feature_clips import video


def folder(tmp_path: Path) -> Path:
    from transformers import VideoMAEConfig, VideoMAEModel

    torch.manual_seed(0)
    cfg = VideoMAEConfig(image_size=32, num_frames=4, hidden_size=16, num_hidden_layers=1, num_attention_heads=2,
                         intermediate_size=16)  # fmt: skip
    VideoMAEModel(cfg).save_pretrained(tmp_path / "tiny")
    return tmp_path / "tiny"


def test_a_clip_is_shown_by_frames_a_constant_stride_apart(tmp_path: Path) -> None:
    path = folder(tmp_path)
    network = videomae.build(videomae.Settings(weights=str(path), device="cpu"))
    clip = video(0, frames=11, size=32)
    found = network(clip)
    assert found.shape == (16,)
    assert np.array_equal(found, network(clip[:10:3]))
    assert not np.allclose(found, network(clip[:4]))
    assert (network.least, network.size, network.about()["network"]) == (4, 32, "VideoMAE (tiny)")


def test_the_file_of_the_weights_names_its_folder_too(tmp_path: Path) -> None:
    path = folder(tmp_path)
    ways = [videomae.build(videomae.Settings(weights=str(way), device="cpu")) for way in (path, path / videomae.FILE)]
    assert np.array_equal(ways[0](video(0)), ways[1](video(0)))


def test_weights_that_lack_a_layer_are_refused(tmp_path: Path) -> None:
    from safetensors.torch import load_file, save_file

    path = folder(tmp_path)
    kept = load_file(path / videomae.FILE)
    dropped = next(iter(sorted(kept)))
    save_file({name: value for name, value in kept.items() if name != dropped}, path / videomae.FILE)
    with pytest.raises(ValueError, match=r"metric\.fvd\.weights=.*tiny lacks weights of VideoMAE"):
        videomae.build(videomae.Settings(weights=str(path), device="cpu"))


def test_a_folder_without_a_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / videomae.FILE).write_bytes(b"")
    with pytest.raises(ValueError, match="is no folder of VideoMAE"):
        videomae.build(videomae.Settings(weights=str(tmp_path), device="cpu"))
