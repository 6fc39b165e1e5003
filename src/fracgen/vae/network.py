"""diffusers' AutoencoderKLWan, or the VAE of patches, with the sizes and the weights of a configuration."""

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
from fracgen.vae.patches import PatchVae, smooth

FILE = "Wan2.1_VAE.pth"
"""Name of the released file."""
SIZES = {"base_dim": "base_dim", "dim_mult": "dim_mult", "res_blocks": "num_res_blocks"}
"""Sizes by the names of `Vae` and of diffusers."""
CLASSES: dict[str, Any] = {"wan": AutoencoderKLWan, "patch": PatchVae}
"""By `Vae.kind`."""
STATISTICS = ("latents_mean", "latents_std")
"""Mean and standard deviation of the 16 channels of a latent, in diffusers' config."""

LOG_VARIANCE = -6.0
"""Of the posterior of random weights: its noise, exp(-3), does not drown a latent of deviation 1."""

NEIGHBOURS = 0.3
"""Gain of a convolution's random part over the frames and pixels that it sees."""


def build(cfg: Vae) -> Any:
    """An AutoencoderKLWan, of the class that `cfg.kind` names, in evaluation mode, float32, on the CPU.

    Its weights are those at `cfg.path`, or random by `cfg.seed`. Raises ValueError for weights that are not there or do
    not fit `cfg`.
    """
    if not cfg.path:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(cfg.seed)
            # Latents of such a network have a deviation near 1, which need not be changed.
            network = _network(cfg, {"latents_mean": [0.0] * CHANNELS, "latents_std": [1.0] * CHANNELS})
            initialise(network)
        return network.eval()
    file, config = find(cfg)
    _check(cfg, config, file.parent)
    with torch.device("meta"):
        network = _network(cfg, {key: config[key] for key in STATISTICS if key in config})
    weights.fit(network, of_diffusers(weights.read(file), network, cfg), file)
    return network.float().eval()


def _network(cfg: Vae, statistics: Mapping[str, list[float]]) -> Any:
    sizes = {theirs: getattr(cfg, ours) for ours, theirs in SIZES.items()}
    return CLASSES[cfg.kind](z_dim=CHANNELS, temperal_downsample=[False, True, True], **sizes, **statistics)


@torch.no_grad()
def initialise(network: Any) -> None:
    """Random weights that let the input through: at first, every convolution rotates the channels of its own pixel.

    With usual weights a signal passes 14 random matrices in a row, which leave little of it but one direction; a
    training of minutes does not repair that. What a convolution adds from neighbouring pixels starts small, what a
    residual block adds starts at 0. A PatchVae becomes a linear codec of smooth pictures instead.
    """
    if isinstance(network, PatchVae):
        network.use(*smooth())
        last: Any = network.quant_conv
        nn.init.constant_(last.bias[CHANNELS:], LOG_VARIANCE)
        return
    convolutions: dict[str, Any] = {
        name: module for name, module in network.named_modules() if isinstance(module, (nn.Conv2d, nn.Conv3d))
    }
    for name, conv in convolutions.items():
        if name.endswith((".conv2", ".proj")):  # the last layer of a residual or an attention block
            nn.init.zeros_(conv.weight)
        else:
            _rotate(conv)
        nn.init.zeros_(conv.bias)
    for name in ("encoder.conv_in", "decoder.conv_in"):
        # The norms behind keep directions only: a constant part turns magnitudes into directions.
        bias = convolutions[name].bias
        nn.init.normal_(bias, std=len(bias) ** -0.5)
    for name in ("quant_conv", "post_quant_conv"):
        nn.init.dirac_(convolutions[name].weight)
    convolutions["quant_conv"].bias[CHANNELS:] = LOG_VARIANCE


def _rotate(conv: Any) -> None:
    """Make a convolution a rotation of the channels at the present frame and pixel, plus little from the neighbours."""
    out, channels = conv.weight.shape[:2]
    nn.init.orthogonal_(conv.weight, gain=NEIGHBOURS)
    twice = conv.kernel_size == (3, 1, 1) and out == 2 * channels  # makes two frames of one, equal at first
    core = nn.init.orthogonal_(torch.empty(out // 2 if twice else out, channels))
    core = torch.cat([core, core]) if twice else core
    rows, columns = (k // 2 for k in conv.kernel_size[-2:])
    taps = conv.weight[:, :, -1] if conv.weight.ndim == 5 else conv.weight  # the present frame is the last one
    taps[:, :, rows, columns] += core


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
    kind = next((kind for kind, made in CLASSES.items() if made.__name__ == config.get("_class_name")), cfg.kind)
    if kind != cfg.kind:
        raise ValueError(f"vae.path={cfg.path} holds a VAE of another kind: set vae.kind={kind} and its sizes, as "
                         f"{folder / 'config.json'} gives them.")  # fmt: skip
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
    if cfg.kind != "wan":
        return dict(tensors)
    ours = names.table(network.state_dict(), cfg.res_blocks)
    return {ours.get(name, name): value for name, value in tensors.items()}


def of_released(network: nn.Module, cfg: Vae) -> dict[str, Tensor]:
    """The tensors of a network by their released names."""
    state = network.state_dict()
    return {name: state[theirs] for name, theirs in names.table(state, cfg.res_blocks).items()}
