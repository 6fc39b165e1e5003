"""The VAE: released and diffusers layouts, pixels and latents, causality, tiles, identity."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from fracgen import vae, weights
from fracgen.config.model import Vae
from fracgen.vae import names, patches
from fracgen.vae import network as networks

TINY = Vae(base_dim=8, dim_mult=[1, 2, 2, 2], res_blocks=1)
PATCH = Vae(kind="patch", base_dim=8, res_blocks=1)
REFERENCE = Path(__file__).parents[1] / "reference" / "wan_vae_keys.json"
"""Names and shapes of all tensors of Wan2.1_VAE.pth."""


@pytest.fixture(scope="module", params=["wan", "patch"])
def sizes(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Vae:
    """Of both kinds; the convolutions of a patch VAE add nothing at first, so that here they have been changed."""
    if request.param == "wan":
        return TINY
    network, folder = vae.build(PATCH), tmp_path_factory.mktemp("patch")
    with torch.random.fork_rng(), torch.no_grad():
        torch.manual_seed(5)
        for half in (network.encoder, network.decoder):
            torch.nn.init.normal_(half.trunk.conv_out.weight, std=0.2)
    network.save_pretrained(folder)
    return replace(PATCH, path=str(folder))


@pytest.fixture(scope="module")
def frozen(sizes: Vae) -> vae.FrozenVae:
    return vae.load(sizes)


@pytest.fixture(scope="module")
def network() -> Any:
    """Random weights with the latent statistics of Wan2.1, which the released file leaves to the program."""
    built = vae.build(TINY)
    with torch.device("meta"):
        wan = networks._network(TINY, {})
    built.register_to_config(latents_mean=wan.config.latents_mean, latents_std=wan.config.latents_std)
    return built


@pytest.fixture(scope="module")
def released(network: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("released")
    torch.save(networks.of_released(network, TINY), folder / networks.FILE)
    return folder


@pytest.fixture(scope="module")
def diffusers(network: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("diffusers")
    network.save_pretrained(folder / "vae")
    return folder


def video(frames: int = 9, height: int = 32, width: int = 48, clips: int = 1) -> Tensor:
    """Random pixels in [0, 1]."""
    return torch.rand(clips, 3, frames, height, width, generator=torch.Generator().manual_seed(1))


def full(cfg: Vae) -> Any:
    with torch.device("meta"):
        return networks._network(cfg, {})


def test_names_and_shapes_at_full_size_are_those_of_the_released_file() -> None:
    mine = {name: list(value.shape) for name, value in networks.of_released(full(Vae()), Vae()).items()}
    assert mine == json.loads(REFERENCE.read_text())
    assert len(mine) == 194


@pytest.mark.parametrize("cfg", [Vae(), Vae(res_blocks=1, dim_mult=[1, 2, 2, 2])], ids=["wan", "tiny"])
def test_no_name_is_in_both_layouts(cfg: Vae) -> None:
    """So that a file needs no mark of its layout."""
    ours = set(full(cfg).state_dict())
    assert not ours & set(names.table(ours, cfg.res_blocks))
    assert len(names.table(ours, cfg.res_blocks)) == len(ours)


def test_the_converter_agrees_with_that_of_diffusers() -> None:
    """On the released names of two residual blocks a level, the only number that diffusers' converter knows."""
    from diffusers.loaders.single_file_utils import convert_wan_vae_to_diffusers

    tensors = {name: torch.tensor(k) for k, name in enumerate(json.loads(REFERENCE.read_text()))}
    theirs = convert_wan_vae_to_diffusers(dict(tensors))
    mine = networks.of_diffusers(tensors, full(Vae()), Vae())
    assert {k: int(v) for k, v in mine.items()} == {k: int(v) for k, v in theirs.items()}


def test_both_layouts_give_the_same_vae(network: Any, released: Path, diffusers: Path) -> None:
    """Folder or file, released or diffusers, with and without vae/: bit for bit, and of one identity."""
    paths = [released, released / networks.FILE, diffusers, diffusers / "vae"]
    loaded = [vae.load(replace(TINY, path=str(path))) for path in paths]
    latents = [one.encode(video()) for one in loaded]
    assert all(torch.equal(latent, latents[0]) for latent in latents)
    assert {one.identity for one in loaded} == {vae.FrozenVae(network).identity}
    assert vae.identity_of(replace(TINY, path=str(released))) == loaded[0].identity


def test_the_identity_tells_weights_and_statistics_apart(network: Any, diffusers: Path, tmp_path: Path) -> None:
    same = vae.load(replace(TINY, path=str(diffusers), tile=32, dtype="bfloat16")).identity
    assert same == vae.load(replace(TINY, path=str(diffusers))).identity
    assert len(same) == 12
    assert vae.load(TINY).identity == vae.load(TINY).identity != vae.load(replace(TINY, seed=1)).identity
    config = json.loads((diffusers / "vae" / "config.json").read_text())
    (tmp_path / "diffusion_pytorch_model.safetensors").symlink_to(
        diffusers / "vae" / "diffusion_pytorch_model.safetensors"
    )
    (tmp_path / "config.json").write_text(json.dumps(config | {"latents_mean": [0.5] * 16}))
    assert vae.load(replace(TINY, path=str(tmp_path))).identity != same


@pytest.mark.parametrize(("change", "message"), [
    (lambda t: t.pop("decoder.head.2.bias"), "lacks decoder.conv_out.bias"),
    (lambda t: t.update(extra=torch.zeros(1)), "has beside them extra"),
    (lambda t: t.update({"conv1.bias": torch.zeros(7)}), r"of another shape quant_conv.bias \[7\] instead of \[32\]"),
])  # fmt: skip
def test_tensors_that_do_not_fit_are_named(
    network: Any, tmp_path: Path, change: Callable[[dict[str, Tensor]], Any], message: str
) -> None:
    tensors = dict(networks.of_released(network, TINY))
    change(tensors)
    torch.save(tensors, tmp_path / networks.FILE)
    with pytest.raises(ValueError, match=message):
        vae.load(replace(TINY, path=str(tmp_path)))


def test_wrong_paths_sizes_and_files_are_refused_by_name(diffusers: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"vae.path=nowhere holds no VAE: give a folder with Wan2.1_VAE.pth"):
        vae.load(Vae(path="nowhere"))
    with pytest.raises(ValueError, match=r"has other sizes: set vae.base_dim=8 vae.dim_mult=\[1,2,2,2\] vae.res_bl"):
        vae.load(Vae(path=str(diffusers)))
    (tmp_path / networks.FILE).write_text("version https://git-lfs.github.com/spec/v1")
    with pytest.raises(ValueError, match=r"Wan2.1_VAE.pth cannot be read as weights"):
        vae.load(Vae(path=str(tmp_path)))


def test_the_hub_is_asked_for_the_files_of_the_vae_only(released: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {}

    def snapshot(name: str, allow_patterns: list[str]) -> str:
        asked[name] = allow_patterns
        return str(released)

    monkeypatch.setattr("huggingface_hub.snapshot_download", snapshot)
    vae.load(replace(TINY, path="someone/model", hub=True))
    assert asked == {"someone/model": ["Wan2.1_VAE.pth", "vae/*"]}


def test_the_latent_has_the_layout_of_the_design(frozen: vae.FrozenVae) -> None:
    latent = frozen.encode(video(17, 32, 48, clips=2))
    assert latent.shape == (2, 16, 5, 4, 6)
    assert latent.dtype == torch.float32
    decoded = frozen.decode(latent)
    assert decoded.shape == (2, 3, 17, 32, 48)
    assert 0 <= decoded.min()
    assert decoded.max() <= 1


def test_a_clip_does_not_depend_on_its_batch(frozen: vae.FrozenVae) -> None:
    clips = video(5, clips=2)
    assert torch.equal(frozen.encode(clips), torch.cat([frozen.encode(clips[:1]), frozen.encode(clips[1:])]))


def test_pixels_enter_in_minus_one_to_one_and_latents_are_normalised(network: Any) -> None:
    """Against diffusers, by hand: black is -1, white is 1, and mean and deviation are removed, not added."""
    one, clip = vae.FrozenVae(network), video(5)
    raw = network.encode(2 * clip - 1).latent_dist.mean
    mean, std = (torch.tensor(network.config[k]).reshape(1, 16, 1, 1, 1) for k in ("latents_mean", "latents_std"))
    latent = one.encode(clip)
    torch.testing.assert_close(latent, (raw - mean) / std)
    torch.testing.assert_close(one.decode(latent), (network.decode(raw).sample + 1) / 2)


@pytest.mark.parametrize("frames", [5, 9])
def test_a_latent_frame_depends_on_no_later_frame(frozen: vae.FrozenVae, frames: int) -> None:
    """Latent frame k knows frames 0 to 4 k; others change nothing, bit for bit, and those up to 4 k do change it."""
    clip, k = video(13), (frames - 1) // 4
    changed = clip.clone()
    changed[:, :, frames:] = 1 - changed[:, :, frames:]
    before, after = frozen.encode(clip), frozen.encode(changed)
    assert torch.equal(before[:, :, : k + 1], after[:, :, : k + 1])
    assert not torch.equal(before[:, :, k + 1], after[:, :, k + 1])


def test_the_first_frame_alone_has_the_first_latent_of_the_clip(frozen: vae.FrozenVae) -> None:
    clip = video()
    assert torch.equal(frozen.encode(clip[:, :, :1]), frozen.encode(clip)[:, :, :1])


@pytest.mark.parametrize(("bad", "message"), [
    (2 * video() - 1, r"values from -0.99\d* to 0.99\d* must lie in \[0, 1\]"),
    (video() * torch.nan, r"values from nan to nan must lie in \[0, 1\]"),
    (video(8), r"frames=8 must be 1 \+ 4 n"),
    (video(5, 32, 40), r"width=40 must be a positive multiple of 16"),
    (video()[0], r"shape \[3, 9, 32, 48\] must be \[clips, 3, frames, rows, columns\]"),
])  # fmt: skip
def test_other_videos_are_refused(frozen: vae.FrozenVae, bad: Tensor, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        frozen.encode(bad)


def test_tiles_change_the_picture_near_seams_only(frozen: vae.FrozenVae, sizes: Vae) -> None:
    """Random latents are the hardest case: a smooth one differs less across a tile's edge.

    A tile sees no latent beyond its edge, so the error decays with the distance from it. The blend gives a tile's edge
    weight 0 and its inner part weight 1; what is left is below that of two unrelated pictures, whose difference has
    sqrt(2) of their deviation. The corner of the first tile that no blend reaches sees only far edges.
    """
    latent = torch.randn(1, 16, 2, 8, 8, generator=torch.Generator().manual_seed(2))
    whole, tiled = frozen.decode(latent), vae.load(replace(sizes, tile=32)).decode(latent)
    error = (whole - tiled).square().mean(dim=(0, 1, 2)).sqrt()
    assert tiled.shape == whole.shape
    assert float(error.max()) > 0
    assert float(error.square().mean().sqrt()) < 0.5 * 2**0.5 * float(whole.std())


def test_encoding_never_uses_tiles(frozen: vae.FrozenVae, sizes: Vae) -> None:
    clip = video(5, 64, 64)
    assert torch.equal(vae.load(replace(sizes, tile=32)).encode(clip), frozen.encode(clip))


def test_half_precision_gives_the_latent_to_its_own_accuracy(frozen: vae.FrozenVae, sizes: Vae) -> None:
    """bfloat16 has 8 significant bits; over some 40 roundings in a row the error stays below 40 / 256 of the size."""
    exact, half = frozen.encode(video(5)), vae.load(replace(sizes, dtype="bfloat16")).encode(video(5))
    assert half.dtype == torch.float32
    assert 0 < float((half - exact).square().mean().sqrt()) < 40 / 256 * float(exact.std())


def test_random_weights_let_the_input_through(frozen: vae.FrozenVae) -> None:
    """A latent of random weights has a deviation of the order of 1, and tells clips apart."""
    black, white = (frozen.encode(torch.full((1, 3, 5, 32, 32), value)) for value in (0.0, 1.0))
    assert 0.1 < float(white.std()) < 10
    assert float((black - white).abs().mean()) > 0.1


def test_a_patch_is_cut_and_joined_without_loss() -> None:
    """A patch holds 4 frames x 8 x 8 pixels of 3 colours, colour by colour; a frame alone stands still for four."""
    clip = video(8, 16, 24)
    cut = patches.cut(clip)
    assert cut.shape == (1, 768, 2, 2, 3)
    assert torch.equal(patches.join(cut), clip)
    assert torch.equal(cut[0, :, 1, 0, 2], clip[0, :, 4:, :8, 16:].reshape(-1))
    assert torch.equal(patches.join(patches.cut(clip[:, :, :1])), clip[:, :, :1].expand(-1, -1, 4, -1, -1))


def test_a_patch_vae_is_the_best_linear_codec_at_first() -> None:
    """By Eckart and Young, no 16 numbers a patch leave less of its variance than the rest of its eigenvalues.

    The patches of the clip are what it is made for, so that it leaves exactly these.
    """
    clip = video(201, 16, 32) ** 3
    rest = torch.cat([patches.cut(2 * part - 1) for part in (clip[:, :, :1], clip[:, :, 1:])], dim=2)
    rows = rest.transpose(0, 1).flatten(1).T
    mean, components, deviations = patches.principal(rows)
    network = vae.build(PATCH)
    network.use(mean, components, deviations)
    latent = network.encode(2 * clip - 1).latent_dist.mode()
    decoded = patches.join(network.decoder.linear(latent))
    cut = patches.cut(decoded).transpose(0, 1).flatten(1).T
    lost = (cut - rows).square().sum(dim=1).mean()
    values = torch.linalg.svdvals((rows - rows.mean(dim=0)).double()).square() / len(rows)
    assert float(lost.detach()) == pytest.approx(float(values[16:].sum()), rel=1e-4)
    torch.testing.assert_close(latent.std(dim=(0, 2, 3, 4), correction=0), torch.ones(16), atol=1e-3, rtol=0)


def test_a_patch_vae_without_data_shows_smooth_pictures() -> None:
    """A picture whose brightness is linear in the place is shown to 1 % of its range, since the components of
    smooth fields are nearly cosines, of which the first four are kept along an axis."""
    rows, columns = torch.meshgrid(torch.linspace(0, 1, 32), torch.linspace(0, 1, 32), indexing="ij")
    clip = (0.5 * rows + 0.5 * columns).expand(1, 3, 5, 32, 32).contiguous()
    one = vae.load(PATCH)
    assert float((one.decode(one.encode(clip)) - clip).square().mean().sqrt()) < 0.01


def test_the_other_kind_of_vae_is_refused_by_name(sizes: Vae, diffusers: Path) -> None:
    with pytest.raises(ValueError, match=r"holds a VAE of another kind: set vae.kind=wan and its sizes"):
        vae.load(replace(PATCH, path=str(diffusers)))
    if sizes.kind == "patch":
        with pytest.raises(ValueError, match=r"holds a VAE of another kind: set vae.kind=patch and its sizes"):
            vae.load(replace(TINY, path=sizes.path))


def test_random_weights_leave_the_random_state_alone() -> None:
    torch.manual_seed(3)
    expected = torch.rand(1)
    torch.manual_seed(3)
    vae.build(TINY)
    assert torch.equal(torch.rand(1), expected)


def test_a_large_file_is_identified_by_its_size_and_blocks_spread_over_it(tmp_path: Path) -> None:
    path = tmp_path / "weights.bin"
    with path.open("wb") as file:
        file.truncate(80 << 20)
    first = weights.digest_files([path])
    with path.open("r+b") as file:
        file.seek(-1, 2)
        file.write(b"1")
    assert first != weights.digest_files([path]) != weights.digest_files([path], about=1)
