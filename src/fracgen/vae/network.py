"""diffusers' AutoencoderKLWan with the sizes and the weights of a configuration."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from diffusers import AutoencoderKLWan
from torch import Tensor, nn

from fracgen import weights
from fracgen.config.model import Vae
from fracgen.layout import CHANNELS
from fracgen.vae import names

FILE = "Wan2.1_VAE.pth"
"""Name of the released file."""
SIZES = {"base_dim": "base_dim", "dim_mult": "dim_mult", "res_blocks": "num_res_blocks"}
"""Sizes by the names of `Vae` and of diffusers."""
STATISTICS = ("latents_mean", "latents_std")
"""Mean and standard deviation of the 16 channels of a latent, in diffusers' config."""


def build(cfg: Vae) -> Any:
    """An AutoencoderKLWan in evaluation mode, float32, on the CPU.

    Its weights are those at `cfg.path`, or random by `cfg.seed`. Raises ValueError for weights that are not there or do
    not fit `cfg`.
    """
    if not cfg.path:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(cfg.seed)
            # Nothing is known of random latents: mean 0 and deviation 1 leave them as they are.
            return _network(cfg, {"latents_mean": [0.0] * CHANNELS, "latents_std": [1.0] * CHANNELS}).eval()
    file, config = find(cfg)
    _check(cfg, config, file.parent)
    with torch.device("meta"):
        network = _network(cfg, {key: config[key] for key in STATISTICS if key in config})
    weights.fit(network, of_diffusers(weights.read(file), network, cfg), file)
    return network.float().eval()


def _network(cfg: Vae, statistics: Mapping[str, list[float]]) -> Any:
    sizes = {theirs: getattr(cfg, ours) for ours, theirs in SIZES.items()}
    return AutoencoderKLWan(  # type: ignore[no-untyped-call]
        z_dim=CHANNELS, temperal_downsample=[False, True, True], **sizes, **statistics
    )


def find(cfg: Vae) -> tuple[Path, dict[str, Any]]:
    """The file of weights at `cfg.path`, and the config beside it if it is one of diffusers; raises ValueError."""
    path = Path(cfg.path).expanduser()
    if cfg.hub and not path.exists():
        path = weights.download(cfg.path, [FILE, "vae/*"], "vae.path")
    candidates = [path] if path.is_file() else [
        path / FILE, *(folder / f"diffusion_pytorch_model.{end}" for folder in (path / "vae", path)
                       for end in ("safetensors", "bin") if (folder / "config.json").is_file())]  # fmt: skip
    for file in candidates:
        if file.is_file():
            config = file.parent / "config.json"
            ours = file.name != FILE and config.is_file()
            return file, json.loads(config.read_text(encoding="utf-8")) if ours else {}
    raise ValueError(
        f"vae.path={cfg.path} holds no VAE: give a folder with {FILE}, a folder of diffusers (config.json and "
        "diffusion_pytorch_model.safetensors, or vae/ with them), or the file; vae.hub=true takes a name on the hub."
    )


def _check(cfg: Vae, config: Mapping[str, Any], folder: Path) -> None:
    """Raise ValueError for a config of diffusers with other sizes than `cfg`, or of another kind of VAE."""
    other = {ours: config[theirs] for ours, theirs in SIZES.items() if config.get(theirs, getattr(cfg, ours)) !=
             getattr(cfg, ours)}  # fmt: skip
    if other:
        fields = " ".join(f"vae.{name}={str(value).replace(' ', '')}" for name, value in other.items())
        raise ValueError(f"vae.path={cfg.path}: {folder / 'config.json'} has other sizes: set {fields}.")
    fixed = {"z_dim": CHANNELS, "is_residual": False, "patch_size": None, "temperal_downsample": [False, True, True]}
    for name, value in fixed.items():
        if config.get(name, value) != value:
            raise ValueError(f"vae.path={cfg.path}: {name}={config[name]} in {folder / 'config.json'} is not that of "
                             f"Wan2.1 ({value}): give a VAE of Wan2.1.")  # fmt: skip


def of_diffusers(tensors: Mapping[str, Tensor], network: nn.Module, cfg: Vae) -> dict[str, Tensor]:
    """`tensors` by diffusers' names, whichever names they have (no name is in both layouts); unknown names stay."""
    ours = names.table(network.state_dict(), cfg.res_blocks)
    return {ours.get(name, name): value for name, value in tensors.items()}


def of_released(network: nn.Module, cfg: Vae) -> dict[str, Tensor]:
    """The tensors of a network by their released names."""
    state = network.state_dict()
    return {name: state[theirs] for name, theirs in names.table(state, cfg.res_blocks).items()}
