"""python -m fracgen.train_vae: what it trains on, resuming, what it writes, what it refuses."""

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fracgen import train_vae, vae
from fracgen.config.model import Vae
from fracgen.config.train_vae import TrainVaeConfig, VaeFolder
from fracgen.vae import clips, fit, judge, patches
from fracsim import codec, dataset
from tests.dataset import tiny

SIZES = Vae(base_dim=4, dim_mult=[1, 1, 1, 1], res_blocks=1)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three clips of 6 frames of 32 x 48 px."""
    return tiny.make(tmp_path_factory.mktemp("clips"), 3)


def config(data: Path, folder: Path, **changes: Any) -> TrainVaeConfig:
    base = TrainVaeConfig(data=str(data), clips=3, held_out=1, frames=5, size=16, batch=2, steps=4, warmup=2, lr=2e-3,
                    save_steps=2, device="cpu", vae=SIZES, output=VaeFolder(folder=str(folder)))  # fmt: skip
    return replace(base, **changes)


@pytest.fixture(scope="module")
def trained(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train_vae.run(config(data, tmp_path_factory.mktemp("vae") / "tiny"))


def test_a_clip_is_colour_maps_and_blobs_of_frames_that_the_vae_takes(data: Path) -> None:
    """6 frames become 5; maps are shown as fracsim.codec shows them, damage by its own scale of 1."""
    (video,) = (v for v in clips.load(str(data), 3) if v.id == dataset.open(data)[0].row["id"])
    assert list(video.streams) == ["rgb", "flow", "strain", "stress", "damage", "force"]
    assert {v.shape for v in video.streams.values()} == {(5, 48, 32, 3)}
    raw = dataset.open(data)[0].read("damage", 0, 5)
    assert np.abs(video.streams["damage"] / 255 - codec.encode(raw, 1.0)).max() <= 0.5 / 255 + 1e-6
    stress = dataset.open(data)[0].read("stress", 0, 5)
    expected = codec.encode(stress, codec.scale(stress, clips.PERCENTILE))
    assert np.abs(video.streams["stress"] / 255 - expected).max() <= 0.5 / 255 + 1e-6


def test_crops_are_parts_of_the_clips_and_drawn_by_their_key(data: Path) -> None:
    videos = clips.load(str(data), 3)
    first = clips.crops(videos, (4, 5, 16, 16), 0, 7)
    assert first.shape == (4, 3, 5, 16, 16)
    assert 0 <= first.min()
    assert first.max() <= 1
    assert torch.equal(first, clips.crops(videos, (4, 5, 16, 16), 0, 7))
    assert not torch.equal(first, clips.crops(videos, (4, 5, 16, 16), 0, 8))
    whole = torch.stack([clips.tensor(v)[0] for one in videos for v in one.streams.values()])
    windows = whole.unfold(3, 16, 1).unfold(4, 16, 1)  # [video, 3, 5, y, x, 16, 16]
    for crop in first:
        assert (windows == crop[None, :, :, None, None]).all(dim=(1, 2, 5, 6)).any()


def test_clips_are_spread_evenly() -> None:
    assert clips.spread(10, 2) == [2, 7]
    assert clips.spread(3, 9) == [0, 1, 2]


def test_the_learning_rate_rises_linearly_and_falls_along_a_cosine() -> None:
    cfg = TrainVaeConfig(steps=110, warmup=10)
    rates = [fit.schedule(step, cfg) for step in (0, 4, 9, 10, 60)]
    assert rates == pytest.approx([0.1, 0.5, 1.0, 1.0, 0.5])
    assert fit.schedule(109, cfg) == pytest.approx(0.5 - 0.5 * math.cos(math.pi / 100))


def test_decoding_for_training_is_that_of_diffusers_without_the_clamp() -> None:
    network = vae.build(SIZES)
    latent = 3 * torch.randn(2, 16, 3, 2, 4, generator=torch.Generator().manual_seed(0))
    raw = fit.decode(network, latent)
    assert float(raw.abs().max()) > 1
    torch.testing.assert_close(raw.clamp(-1, 1), network.decode(latent).sample)


def test_pixels_beyond_white_and_black_keep_a_gradient() -> None:
    """A decoder that shows black everywhere must be able to leave it."""
    network = vae.build(SIZES).requires_grad_(True)
    with torch.no_grad():
        network.decoder.conv_out.bias.fill_(-5)
    cfg = TrainVaeConfig(kl=0, edges=0, vae=SIZES)
    fit.loss(network, torch.ones(1, 3, 5, 16, 16), cfg, 0).backward()  # type: ignore[no-untyped-call]
    # The error is below -2 where black is taken for white; a channel's share of its mean square has 2 / 3 as slope.
    assert float(network.decoder.conv_out.bias.grad.max()) < -2 * fit.PIXELS * 2 / 3


def test_training_makes_the_error_smaller() -> None:
    """To less than half within 30 steps on crops of one colour each, which a linear network can show."""
    videos = [clips.Videos("a", {"rgb": np.full((5, 16, 16, 3), level, np.uint8)}) for level in (0, 255)]
    sizes = Vae(base_dim=8, dim_mult=[1, 2, 2, 2], res_blocks=1)
    cfg = TrainVaeConfig(steps=30, warmup=5, frames=5, size=16, batch=4, lr=2e-3, vae=sizes)
    network = vae.build(sizes)
    crops = torch.cat([clips.tensor(v.streams["rgb"]) for v in videos])
    before = float(fit.loss(network, crops, cfg, 0).detach())
    assert list(fit.steps(cfg, network, videos, fit.optimiser(cfg, network), range(30))) == list(range(30))
    assert float(fit.loss(network, crops, cfg, 0).detach()) < before / 2


def test_a_patch_vae_starts_from_the_principal_components_of_the_clips(data: Path, tmp_path: Path) -> None:
    """After one step of no length it is the linear codec of patches of random crops."""
    sizes = Vae(kind="patch", base_dim=8, res_blocks=1)
    videos = clips.load(str(data), 3)
    cfg = config(data, tmp_path, steps=1, warmup=1, lr=1e-12, vae=sizes)
    trained, expected = fit.train(cfg, vae.build(sizes), videos), vae.build(sizes)
    expected.use(*patches.principal(fit.sample_patches(cfg, videos)))
    for name in ("encoder.linear.weight", "decoder.linear.weight", "decoder.linear.bias"):
        torch.testing.assert_close(trained.state_dict()[name], expected.state_dict()[name])


def test_a_training_that_was_cut_off_gives_the_weights_of_one_that_was_not(
    data: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cut between checkpoints, at step 3 of 4: bit for bit."""
    cfg, loss = config(data, tmp_path / "cut"), fit.loss

    def cut(network: Any, crops: Any, cfg: TrainVaeConfig, step: int) -> Any:
        if step == 3:
            raise KeyboardInterrupt
        return loss(network, crops, cfg, step)

    monkeypatch.setattr(fit, "loss", cut)
    with pytest.raises(KeyboardInterrupt):
        train_vae.run(cfg)
    left = [path.name for path in (tmp_path / "cut").iterdir()]
    assert left == [fit.CHECKPOINT]  # nothing that could be taken for a finished VAE
    with pytest.raises(ValueError, match=r"holds the beginning of a training with lr=0.002: repeat it with these"):
        train_vae.run(replace(cfg, lr=1e-3))
    monkeypatch.setattr(fit, "loss", loss)
    train_vae.run(cfg)
    first, second = (vae.load(replace(SIZES, path=str(folder))).identity for folder in (trained, tmp_path / "cut"))
    assert first == second


def test_the_folder_holds_weights_errors_and_a_sheet(data: Path, trained: Path) -> None:
    found = json.loads((trained / train_vae.RESULT).read_text())
    assert sorted(path.name for path in trained.iterdir()) == [
        "config.json", "diffusion_pytorch_model.safetensors", "sheet.png", train_vae.RESULT]  # fmt: skip
    assert list(found["streams"]) == ["rgb", "flow", "strain", "stress", "damage", "force"]
    assert found["identity"] == vae.load(replace(SIZES, path=str(trained))).identity
    assert (found["steps"], len(found["held_out"])) == (4, 1)


def test_latents_of_the_training_clips_have_mean_0_and_deviation_1(data: Path, trained: Path) -> None:
    """Over all streams of the clips that were trained on, by the statistics in config.json."""
    held_out = json.loads((trained / train_vae.RESULT).read_text())["held_out"]
    loaded = vae.load(replace(SIZES, path=str(trained)))
    videos = [v for v in clips.load(str(data), 3) if v.id not in held_out]
    latents = torch.cat([loaded.encode(clips.tensor(s)) for v in videos for s in v.streams.values()])
    torch.testing.assert_close(latents.mean(dim=(0, 2, 3, 4)), torch.zeros(16), atol=1e-3, rtol=0)
    torch.testing.assert_close(latents.std(dim=(0, 2, 3, 4), correction=0), torch.ones(16), atol=1e-3, rtol=0)


def test_the_error_of_a_stream_is_its_psnr() -> None:
    """A reconstruction that is wrong by 0.1 everywhere has 20 dB; a video of black and white halves 6.02 dB."""
    video = np.zeros((5, 16, 16, 3), np.uint8)
    video[:, :8] = 255

    class Wrong:
        def encode(self, clip: torch.Tensor) -> torch.Tensor:
            return clip

        def decode(self, latent: torch.Tensor) -> torch.Tensor:
            return (latent - 0.1).abs()

    found = judge.errors(Wrong(), [clips.Videos("a", {"rgb": video})])  # type: ignore[arg-type]
    assert found == {"rgb": {"psnr": 20.0, "psnr_of_one_colour": 6.02}}


def test_a_finished_folder_is_kept(data: Path, trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = (trained / train_vae.RESULT).read_bytes()
    assert train_vae.run(config(data, trained)) == trained
    assert "is finished; set output.overwrite=true" in capsys.readouterr().out
    assert (trained / train_vae.RESULT).read_bytes() == before


@pytest.mark.parametrize(("changes", "message"), [
    ({"frames": 6}, r"frames=6 must be 1 \+ 4 n"),
    ({"size": 24}, r"width=24 must be a positive multiple of 16"),
    ({"frames": 9}, r"frames=9 size=16 are larger than clip \w+, which has 5 frames of 32 x 48 px: set frames=5"),
    ({"device": "cuda"}, r"device=cuda is not there: set device=cpu"),
])  # fmt: skip
def test_what_cannot_be_trained_on_is_refused(
    data: Path, tmp_path: Path, changes: dict[str, Any], message: str
) -> None:
    if changes.get("device") == "cuda" and torch.cuda.is_available():
        changes["device"], message = "mps", "device=mps is not there"
    with pytest.raises(ValueError, match=message):
        train_vae.run(config(data, tmp_path, **changes))


def test_a_folder_of_another_vae_is_not_written_over(data: Path, trained: Path, tmp_path: Path) -> None:
    shutil.copy(trained / "config.json", tmp_path)
    with pytest.raises(ValueError, match="holds a VAE that this program has not made"):
        train_vae.run(config(data, tmp_path))


def test_one_clip_and_none_are_too_few(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="nowhere"):
        clips.load("nowhere", 3)
    with pytest.raises(ValueError, match=r"has 1 clip\(s\), but training and judging need 2 or more"):
        clips.load(str(tiny.make(tmp_path, 1)), 3)


def test_the_command_line_composes_and_explains_itself() -> None:
    cfg = train_vae.PROGRAM.compose("data=here", "steps=7", "output.folder=there")
    assert (cfg.data, cfg.steps, cfg.output.folder, cfg.vae.path) == ("here", 7, "there", "")
    text = train_vae.PROGRAM.manual()
    assert text.startswith("Train a small video autoencoder")
    assert "vae.base_dim" in text
    assert "edges" in text
    with pytest.raises(ValueError, match="held_out=9 must be below clips=4"):
        train_vae.PROGRAM.compose("held_out=9", "clips=4")
