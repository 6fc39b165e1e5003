"""Training of a VAE: reconstruction, little divergence from a standard normal, resumable at any step."""

import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torch import Tensor, nn

from fracgen import draws
from fracgen.config.train_vae import TrainVaeConfig
from fracgen.vae import clips
from fracgen.vae.patches import PatchVae, cut, principal

CHECKPOINT = "last.pt"
CROPS = 96
"""Crops from which principal components are computed."""
CLIP = 1.0
"""Largest norm of the gradient."""
PIXELS = 4.0
"""Weight of the squared error of pixels, which the PSNR measures."""
SLOW = 0.05
"""Learning rate of the linear codec of `patches`, as a part of that of the other weights."""
BETAS = (0.9, 0.99)
"""Decay of Adam's averages: a short training forgets early gradients soon."""


def train(cfg: TrainVaeConfig, network: Any, videos: Sequence[clips.Videos]) -> Any:
    """The trained `network`, from the checkpoint in the output folder on if there is one.

    Raises ValueError for a checkpoint of another configuration.
    """
    if isinstance(network, PatchVae):
        network.use(*principal(sample_patches(cfg, videos)))
    made = optimiser(cfg, network)
    file = Path(cfg.output.folder).expanduser() / CHECKPOINT
    first = _resume(file, cfg, network, made)
    for step in steps(cfg, network, videos, made, range(first, cfg.steps)):
        if (step + 1) % cfg.save_steps == 0 or step + 1 == cfg.steps:
            _save(file, cfg, network, made, step + 1)
    return network.eval()


def sample_patches(cfg: TrainVaeConfig, videos: Sequence[clips.Videos]) -> Tensor:
    """Patches [n, 768] in [-1, 1] of random crops, the first frame of a crop being one of its own."""
    shape = (1, cfg.frames, cfg.size, cfg.size)
    crops = (2 * clips.crops(videos, shape, cfg.seed, k, "principal") - 1 for k in range(CROPS))
    parts = [cut(half) for crop in crops for half in (crop[:, :, :1], crop[:, :, 1:]) if half.shape[2]]
    return torch.cat([part.transpose(0, 1).flatten(1).T for part in parts])


def optimiser(cfg: TrainVaeConfig, network: nn.Module) -> torch.optim.Optimizer:
    """AdamW without decay over all weights of `network`; the linear codec, which is good at once, changes slowly."""
    network.train().requires_grad_(True)
    parts = {name: [p for key, p in network.named_parameters() if (".linear." in key) == (name == "linear")]
             for name in ("linear", "others")}  # fmt: skip
    groups = [{"params": found, "part": SLOW if name == "linear" else 1.0} for name, found in parts.items() if found]
    return torch.optim.AdamW(groups, lr=cfg.lr, betas=BETAS, weight_decay=0)


def steps(
    cfg: TrainVaeConfig, network: Any, videos: Sequence[clips.Videos], made: torch.optim.Optimizer, numbers: range
) -> Iterator[int]:
    """Take the optimiser steps `numbers`, giving the number of each when it is done; raises ValueError at infinity."""
    shape = (cfg.batch, cfg.frames, cfg.size, cfg.size)
    for step, show in shown(numbers):
        for group in made.param_groups:
            group["lr"] = cfg.lr * schedule(step, cfg) * group["part"]
        value = loss(network, clips.crops(videos, shape, cfg.seed, step), cfg, step)
        made.zero_grad(set_to_none=True)
        value.backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        if not bool(norm.isfinite()):
            raise ValueError(f"the gradient is not finite at step {step}: lower lr={cfg.lr:g}, or raise warmup="
                             f"{cfg.warmup}, and set output.overwrite=true.")  # fmt: skip
        made.step()
        show(float(value.detach()))
        yield step


def shown(numbers: range) -> Iterator[tuple[int, Callable[[float], None]]]:
    """Each number with a function that takes its loss, and a bar with the last loss and the time left in a terminal."""
    columns = (TextColumn("train"), BarColumn(16), MofNCompleteColumn(), TimeRemainingColumn(),
               TextColumn("left  loss {task.fields[loss]}"))  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as bar:
        task = bar.add_task("train", total=len(numbers), loss="")
        for number in numbers:
            yield number, lambda loss: bar.update(task, loss=f"{loss:.4f}")
            bar.advance(task)


def schedule(step: int, cfg: TrainVaeConfig) -> float:
    """Learning rate of a step as a part of the largest: linear warm-up, then a cosine to 0."""
    if step < cfg.warmup:
        return (step + 1) / cfg.warmup
    return 0.5 + 0.5 * math.cos(math.pi * (step - cfg.warmup) / max(1, cfg.steps - cfg.warmup))


def loss(network: Any, crops: Tensor, cfg: TrainVaeConfig, step: int) -> Tensor:
    """The loss of crops [B, 3, F, S, S] in [0, 1]: squared error of pixels, absolute error of edges, divergence."""
    pixels = (2 * crops - 1).to(network.device)
    posterior = network.encode(pixels).latent_dist
    noise = draws.normal(tuple(posterior.mean.shape), cfg.seed, step, "posterior").to(pixels)
    error = decode(network, posterior.mean + posterior.std * noise) - pixels
    edges = sum((error.diff(dim=axis).abs().mean() for axis in (-1, -2)), torch.zeros_like(error.sum()))
    divergence = posterior.kl().sum() / noise.numel()
    out: Tensor = PIXELS * error.square().mean() + cfg.edges * edges + cfg.kl * divergence
    return out


def decode(network: Any, latent: Tensor) -> Tensor:
    """The decoded clip [B, 3, F, S, S] of a latent that is not normalised, without the clamp of `network.decode`.

    Behind the clamp a pixel has no gradient: streams that are mostly black would keep white ones black for ever.
    """
    memory = [None] * sum(1 for _ in network.decoder.modules())  # of the causal convolutions, one place each
    z = network.post_quant_conv(latent)
    parts = [network.decoder(z[:, :, k : k + 1], feat_cache=memory, feat_idx=[0], first_chunk=k == 0)
             for k in range(z.shape[2])]  # fmt: skip
    return torch.cat(parts, dim=2)


def _about(cfg: TrainVaeConfig) -> dict[str, Any]:
    """What shapes the weights."""
    left_out = ("output", "save_steps", "device", "data")
    return {name: value for name, value in asdict(cfg).items() if name not in left_out}


def _save(file: Path, cfg: TrainVaeConfig, network: nn.Module, optimiser: torch.optim.Optimizer, step: int) -> None:
    part = file.with_suffix(".partial")
    state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "step": step, "about": _about(cfg)}
    torch.save(state, part)
    os.replace(part, file)


def _resume(file: Path, cfg: TrainVaeConfig, network: nn.Module, optimiser: torch.optim.Optimizer) -> int:
    """Load a checkpoint, if there is one, and give its step; raises ValueError for one of another configuration."""
    if not file.is_file() or cfg.output.overwrite:
        return 0
    state = torch.load(file, map_location="cpu", weights_only=True)
    other = [f"{name}={state['about'].get(name)}" for name, value in _about(cfg).items()
             if state["about"].get(name) != value]  # fmt: skip
    if other:
        raise ValueError(f"output.folder={cfg.output.folder} holds the beginning of a training with {', '.join(other)}"
                         ": repeat it with these, set output.overwrite=true, or choose another folder.")  # fmt: skip
    network.load_state_dict(state["network"])
    optimiser.load_state_dict(state["optimiser"])
    return int(state["step"])


def device(name: str) -> torch.device:
    """The device called `name`; raises ValueError when it is not there."""
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    there = {"cpu": True, "cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    if not there[name]:
        raise ValueError(f"device={name} is not there: set device=cpu.")
    return torch.device(name)
