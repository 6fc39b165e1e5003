"""Compute again what was not finite: `python -m fracgen.train replay=runs/stage1-ID/nan-STEP.safetensors`."""

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from fracgen.config.train import Recipe, TrainConfig
from fracgen.data.batch import Batch
from fracgen.training import checkpoint, network
from fracgen.training.guard import BATCH, WEIGHTS, unflat
from fracgen.training.module import Module


def run(file: Path | str) -> str:
    """What the step of a file gives when computed again, clip by clip, as text: in float32 and as it was trained.

    Raises ValueError when the file cannot be read.
    """
    module, batch, step = load(file)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    module.to(device)
    network.settle(module.transformer, module.cfg, module.tokens)
    lines = [f"{file}: optimiser step {step}, {len(batch.ids)} clips"]
    for precision in dict.fromkeys((module.cfg.trainer.precision, "32-true")):
        if precision == "32-true" and module.cfg.trainer.base_dtype != "float32" and module.cfg.model.train == "lora":
            for parameter in module.parameters():  # what a base in bfloat16 gives when it is computed in float32
                parameter.data = parameter.data.float()
        for k, name in enumerate(batch.ids):
            lines.append(f"{precision}  {name}: {attempt(module, one(batch, k, device), step, precision)}")
    return "\n".join(lines)


def load(file: Path | str) -> tuple[Module, Batch, int]:
    """The module, the batch and the optimiser step of a file; raises ValueError when it cannot be read."""
    try:
        with safe_open(str(file), framework="pt") as content:
            about = json.loads((content.metadata() or {})["about"])
            tensors = {name: content.get_tensor(name) for name in content.keys()}  # noqa: SIM118
    except (OSError, KeyError, ValueError, SafetensorError) as error:
        raise ValueError(
            f"replay={file} cannot be read ({error}): give a file nan-STEP.safetensors of a run."
        ) from None
    cfg = of_dict(about["config"])
    recipe = Recipe(**about["recipe"])
    module = Module(cfg, recipe, network.build(cfg, tuple(recipe.streams)), total=1)
    checkpoint.load(module, _part(tensors, WEIGHTS))
    return module, unflat(about["ids"], _part(tensors, BATCH)), about["step"]


def of_dict(content: dict[str, Any]) -> TrainConfig:
    """The configuration that `dataclasses.asdict` has taken apart."""
    from omegaconf import OmegaConf

    cfg = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(TrainConfig), content))
    assert isinstance(cfg, TrainConfig)
    return cfg


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}


def one(batch: Batch, k: int, device: torch.device) -> Batch:
    """Clip `k` of a batch, as a batch [1, ...] on a device; keys of random draws stay on the CPU."""
    keys = {"indices": batch.indices[k : k + 1], "epoch": batch.epoch[k : k + 1], "slot": batch.slot[k : k + 1]}
    parts = {name: t[k : k + 1].to(device) for name, t in batch._asdict().items()
             if isinstance(t, Tensor) and name not in keys}  # fmt: skip
    latents = {name: t[k : k + 1].to(device) for name, t in batch.latents.items()}
    return Batch(ids=batch.ids[k : k + 1], latents=latents, image=parts.pop("image", None), **keys, **parts)


def attempt(module: Module, batch: Batch, step: int, precision: str) -> str:
    """Loss by stream and norm of the gradient of a batch, and the first layer whose output is not finite."""
    culprits: list[str] = []
    leaves = [(name, layer) for name, layer in module.named_modules() if not list(layer.children())]
    hooks = [layer.register_forward_hook(_looker(name, culprits)) for name, layer in leaves]
    try:
        module.zero_grad()
        with torch.autocast(batch.force.device.type, torch.bfloat16, enabled=precision == "bf16-mixed"):
            losses = module.losses(batch, module.draw(batch), step)
        losses.total.backward()  # type: ignore[no-untyped-call]
    finally:
        for hook in hooks:
            hook.remove()
    norm = nn.utils.get_total_norm([p.grad for _, p in module.trained() if p.grad is not None])
    streams = ", ".join(f"{n} {v:.4g}" for n, v in zip(module.streams, losses.streams[0].tolist(), strict=True))
    where = f", first not finite: {culprits[0]}" if culprits else ""
    sigma = float(losses.sigma)
    return f"loss {losses.total.item():.4g} ({streams}), sigma {sigma:.3f}, gradient {float(norm):.4g}{where}"


def _looker(name: str, culprits: list[str]) -> Any:
    """A forward hook that notes its layer when an output is not finite."""

    def look(layer: nn.Module, inputs: Any, output: Any) -> None:
        if isinstance(output, Tensor) and not bool(torch.isfinite(output).all()):
            culprits.append(name)

    return look
