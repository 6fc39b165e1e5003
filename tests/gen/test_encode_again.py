"""python -m fracgen.encode: nothing is computed twice, what stops goes on, and what cannot be used is refused."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

import fracgen.data
import fracsim.dataset
from fracgen import encode as command
from fracgen import vae
from fracgen.data import encoding
from fracgen.data.summary import Summary
from fracsim.sample import read
from tests.command import environment, python
from tests.gen.clips import FoldedVae, random_clips
from tests.gen.encodings import CPU, cfg, clips_fixture, near, run, simulated_fixture  # noqa: F401


def test_nothing_is_encoded_that_is_not_asked_for(clips: Path, tmp_path: Path) -> None:
    """Eight clips of two loadings."""
    summary, encoded = run(cfg(clips, tmp_path, streams=["rgb", "stress"]))
    assert (summary.done, encoded) == (8, 8 * 2 + 2)
    assert fracgen.data.open(tmp_path).streams == ("rgb", "stress")


def test_nothing_is_encoded_twice(tmp_path: Path) -> None:
    data = random_clips(tmp_path / "data", ["duck", "bear"], speeds=[1.0])
    config = cfg(data, tmp_path / "latents", streams=["rgb"])
    assert run(config)[1] == 2 + 1
    assert run(config)[1] == 0
    random_clips(data, ["duck", "star"], speeds=[2.0])
    summary, encoded = run(config)
    assert (summary.todo, summary.asked, encoded) == (2, 4, 2 + 1)
    cache = fracgen.data.open(tmp_path / "latents")
    assert [row["object"] for row in cache.rows[:2]] == [
        fracsim.dataset.open(data).filter(id=row["id"])[0].row["object"] for row in cache.rows[:2]
    ]


def test_a_clip_whose_sample_has_changed_is_encoded_again(tmp_path: Path) -> None:
    data = random_clips(tmp_path / "data", ["duck", "bear"], speeds=[1.0])
    config = cfg(data, tmp_path / "latents", streams=["rgb"])
    run(config)
    old = fracgen.data.open(tmp_path / "latents")
    (bear,) = (k for k, row in enumerate(old.rows) if row["object"] == "bear")
    before = old[bear].latents["rgb"].clone()
    shutil.rmtree(data / old.rows[bear]["id"])
    random_clips(data, ["bear"], speeds=[1.0])  # its pictures are now those of seed 0
    summary, encoded = run(config)
    assert (summary.todo, encoded) == (1, 1)
    new = fracgen.data.open(tmp_path / "latents")
    assert (len(new), new.rows[bear]["id"]) == (2, old.rows[bear]["id"])
    assert not torch.equal(new[bear].latents["rgb"], before)


def same(one: Path, two: Path) -> bool:
    """Whether two caches have the same clips in the same order, and the same numbers."""
    a, b = fracgen.data.open(one), fracgen.data.open(two)
    without = [[{k: v for k, v in row.items() if k != "shard"} for row in cache.rows] for cache in (a, b)]
    return without[0] == without[1] and all(
        torch.equal(a[k].latents[name], b[k].latents[name])
        and torch.equal(a[k].force, b[k].force)
        and torch.equal(a[k].text, b[k].text)
        for k in range(len(a))
        for name in a.streams
    )


def test_an_encoding_that_stops_goes_on(clips: Path, tmp_path: Path) -> None:
    whole, config = cfg(clips, tmp_path / "whole", streams=["rgb"]), cfg(clips, tmp_path / "part", streams=["rgb"])
    run(whole)

    class Stopping(FoldedVae):
        def encode(self, video: Tensor) -> Tensor:
            if self.encoded == 5:
                raise KeyboardInterrupt
            return super().encode(video)

    folded = Stopping()
    with pytest.raises(KeyboardInterrupt):
        encoding.encode(config, folded, CPU)
    kept = len(fracgen.data.open(tmp_path / "part"))
    assert kept >= 3  # of five videos at most two are forces
    summary, encoded = run(config)
    assert summary.todo == 8 - kept
    assert folded.encoded + encoded <= 8 + 2 + 1  # only the clip that was interrupted is encoded again
    assert same(tmp_path / "part", tmp_path / "whole")


TINY = ("vae=tiny", "vae.base_dim=4", "encoders=tiny", "width=32", "height=48", "frames=1", "streams=[rgb]")
"""A VAE of random weights, small and fast."""


def start(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen([sys.executable, "-m", "fracgen.encode", *arguments], env=environment(OMP_NUM_THREADS="1"),
                            text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)  # fmt: skip


def test_a_command_that_is_killed_goes_on(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """kill -9 after the first file; the repeated command ends with what one that was not killed has."""
    asked = (f"data={clips}", *TINY, "output.shard_mb=1e-4")
    process = start(*asked, f"output.folder={tmp_path / 'killed'}")
    while process.poll() is None and not list((tmp_path / "killed").glob("shard-*")):
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    for name in ("killed", "whole"):
        command.encode(command.ENCODE.compose(*asked, f"output.folder={tmp_path / name}"))
    assert "8 clips encoded" in capsys.readouterr().out
    assert same(tmp_path / "killed", tmp_path / "whole")


def test_clips_that_cannot_be_used_are_left_out_by_reason(tmp_path: Path) -> None:
    data = random_clips(tmp_path / "data", ["duck", "bear"], speeds=[1.0])
    random_clips(data, ["star"], speeds=[1.0], maps=["damage"])
    random_clips(data, ["star"], speeds=[2.0], fps=50)
    random_clips(data, ["star"], speeds=[3.0], size=(48, 48))
    config = cfg(data, tmp_path / "latents")
    summary, _ = run(config)
    assert summary.done == 2
    assert {reason: len(ids) for reason, ids in summary.left_out.items()} == {
        "recorded without flow, strain, stress": 1, "50 frames a second, not 100": 1,
        "48 x 48 px, no whole multiple of width=32 x height=48": 1}  # fmt: skip
    with pytest.raises(ValueError, match=r"1 clip\(s\) left out: recorded without .* strict=false leaves such clips"):
        run(cfg(data, tmp_path / "latents", strict=True))
    with pytest.raises(ValueError, match=r"5 clip\(s\) left out: 6 frames, fewer than frames=9"):
        run(cfg(data, tmp_path / "other", frames=9, streams=["rgb"]))


def test_a_damaged_sample_is_left_out_too(tmp_path: Path) -> None:
    data = random_clips(tmp_path / "data", ["duck", "bear"], speeds=[1.0])
    fracsim.dataset.open(data)
    path = sorted(data.glob("*/rgb.mkv"))[0]
    path.write_bytes(bytes(path.stat().st_size))
    config = cfg(data, tmp_path / "latents", streams=["rgb"])
    summary, _ = run(config)
    ((reason, ids),) = summary.left_out.items()
    assert (summary.done, ids) == (1, [path.parent.name])
    assert "rgb.mkv" in reason
    with pytest.raises(ValueError, match=r"rgb\.mkv"):
        run(cfg(data, tmp_path / "latents", streams=["rgb"], strict=True))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"frames": 1}, "frames=5, but frames=1 is"),
        ({"percentile": 99.0}, r"normalisation=\{'version': 1, 'percentile': 99.5\}, but .* 'percentile': 99.0\}"),
        ({"streams": ["rgb", "damage"]}, r"streams=\['rgb'\], but streams=\['rgb', 'damage'\] is"),
        ({"frame_select": "tail"}, "frame_select=head, but frame_select=tail is"),
        ({"text_dim": 16}, "text=words-8, but text=words-16 is"),
        ({"width": 16, "height": 16, "streams": ["rgb"]}, None),
    ],
)
def test_a_cache_made_otherwise_is_refused_before_anything_is_encoded(
    clips: Path, tmp_path: Path, change: dict[str, Any], told: str | None
) -> None:
    folder = tmp_path / "latents"
    run(cfg(clips, folder, streams=["rgb"]))
    folded = FoldedVae()
    with pytest.raises(ValueError, match=told or "no whole multiple"):
        encoding.encode(cfg(clips, folder, **{"streams": ["rgb"], **change}), folded, CPU)
    assert folded.encoded == 0


def test_another_vae_is_refused(clips: Path, tmp_path: Path) -> None:
    run(cfg(clips, tmp_path, streams=["rgb"]))
    folded = FoldedVae()
    folded.identity = "other"
    with pytest.raises(ValueError, match="vae=folded, but vae=other is asked for: choose another"):
        encoding.encode(cfg(clips, tmp_path, streams=["rgb"]), folded, CPU)


def test_a_disk_that_is_too_small_is_named_first(clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A clip of rgb takes 2 bytes x 16 channels x 4 x 6 x (2 latent frames + 1 reference) = 2304 bytes."""
    config = cfg(clips, tmp_path, streams=["rgb"])
    assert encoding.clip_bytes(config) == 2304
    folded, usage = FoldedVae(), encoding.shutil.disk_usage(tmp_path)
    monkeypatch.setattr(encoding.shutil, "disk_usage", lambda _: usage._replace(free=8 * 2304 - 1))
    with pytest.raises(ValueError, match=r"GB free, but the latents of 8 clips take .*: choose another folder"):
        encoding.encode(config, folded, CPU)
    assert folded.encoded == 0


def test_latents_that_are_not_finite_are_refused(clips: Path, tmp_path: Path) -> None:
    class Overflowing(FoldedVae):
        def encode(self, video: Tensor) -> Tensor:
            return super().encode(video) / 0

    with pytest.raises(ValueError, match=r"vae\.dtype=float32: the VAE gives numbers that are not finite"):
        encoding.encode(cfg(clips, tmp_path, streams=["rgb"]), Overflowing(), CPU)


def test_latents_far_from_mean_0_and_deviation_1_are_warned_of() -> None:
    summary = Summary(1, 1)
    draw = torch.Generator().manual_seed(0)
    for _ in range(2):
        summary.count({"rgb": torch.randn(10_000, generator=draw), "flow": 3 + torch.randn(10_000, generator=draw),
                       "damage": torch.randn(10_000, generator=draw) / 4})  # fmt: skip
    mean, std = summary.statistics()["flow"]
    # Standard errors of 20,000 numbers: 0.007 and 0.005; five of them.
    assert (mean, std) == (pytest.approx(3, abs=0.035), pytest.approx(1, abs=0.025))
    assert "those of flow (+" in summary.odd()
    assert "damage" in summary.odd()
    assert "rgb" not in summary.odd()
    assert Summary(0, 0).odd() == ""


def test_verifying_names_what_has_changed(clips: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = cfg(clips, tmp_path, streams=["rgb"])
    run(config)
    command.verify(config)
    assert "8 clips in 11 files" in capsys.readouterr().out  # 8 of a clip each, 2 forces, 1 of captions
    path = tmp_path / "shard-00003.safetensors"
    path.write_bytes(path.read_bytes()[:-1] + b"\1")
    with pytest.raises(ValueError, match=r"shard-00003\.safetensors has changed: .* Remove such files and repeat"):
        command.verify(config)
    path.unlink()
    assert run(config)[1] == 1
    command.verify(config)
    assert "8 clips" in capsys.readouterr().out


def test_the_reference_of_the_real_vae_is_the_latent_of_the_first_frame_alone(tmp_path: Path) -> None:
    data = random_clips(tmp_path / "data", ["duck"], speeds=[1.0])
    config = command.ENCODE.compose(*TINY, "frames=5", f"data={data}", f"output.folder={tmp_path / 'latents'}")
    command.encode(config)
    cache = fracgen.data.open(tmp_path / "latents")
    first = torch.from_numpy(read(data / cache.rows[0]["id"]).rgb[:1]).permute(3, 0, 1, 2)[None].float() / 255
    latent = vae.load(config.vae).encode(first)[0, :, 0]
    # Convolutions over another number of frames may add in another order; bfloat16 has 8 bits.
    assert torch.allclose(cache[0].reference.float(), latent, atol=1e-5, rtol=2**-8)
    assert json.loads((tmp_path / "latents/cache.json").read_text())["fps"] == 100


def test_a_bad_config_is_refused_by_name() -> None:
    for override, told in (("frames=80", "frames=80 must be 1"), ("width=500", "width=500 must be a positive multiple"),
                           ("streams=[flow]", "name rgb"), ("percentile=101", "percentile=101 is not allowed"),
                           ("vae=huge", "huge")):  # fmt: skip
        with pytest.raises(ValueError, match=told):
            command.ENCODE.compose(override)
    assert command.ENCODE.compose().text_dim == 4096
    assert command.ENCODE.compose("encoders=tiny").text_dim == 64


def test_a_device_that_is_not_there_is_named(clips: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    config = command.ENCODE.compose(*TINY, "device=cuda", f"data={clips}", f"output.folder={tmp_path}")
    with pytest.raises(ValueError, match="device=cuda is not on this machine: set device=cpu"):
        command.encode(config)


def test_the_help_needs_no_torch() -> None:
    text, modules = python(
        "from fracgen.encode import ENCODE; import sys; print(ENCODE.manual(), '---', *sys.modules)"
    ).split("---")[-2:]
    assert "percentile=99.5" in text
    assert not {"torch", "diffusers", "lightning"} & set(modules.split())
