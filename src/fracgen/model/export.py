"""What a training has made, for other programs: its LoRA as a file in two namings, or the whole model, merged."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils import parametrize

from fracgen.config.export import COMFYUI, DIFFUSERS, MERGED, ExportConfig
from fracgen.model import FracTransformer, adapter, trained
from fracgen.model.released import to_released
from fracgen.model.write import save_released

PREFIX = {DIFFUSERS: "transformer.", COMFYUI: "diffusion_model."}
"""What names in a file of a LoRA begin with."""
METADATA = "lora_adapter_metadata"
"""Where diffusers writes, and looks for, rank and alpha."""


def export(cfg: ExportConfig) -> Path:
    """Write what `cfg` names and return where it lies; raises ValueError for a run that has no such form."""
    run = trained.find(cfg.run)
    dtype: torch.dtype = getattr(torch, cfg.dtype)
    name = MERGED if cfg.naming == MERGED else f"lora_{cfg.naming}.safetensors"
    output = Path(cfg.output).expanduser() if cfg.output else run.parent / name
    if cfg.naming == MERGED:
        merge(run, output, dtype, cfg.base)
    else:
        save_lora(run, output, cfg.naming, dtype)
    return output


def save_lora(run: Path | str, path: Path | str, naming: str, dtype: torch.dtype = torch.float32) -> None:
    """Write the LoRA of a run, at once, by the names of diffusers or of ComfyUI.

    alpha is written where it is not the rank, which readers take it for: for diffusers in the metadata, for ComfyUI
    beside each layer. Raises ValueError for a run that trained anything else than a LoRA.
    """
    tensors, about = trained.read(run)
    own = trained.part(tensors, trained.TRANSFORMER)
    lora = about["model"]["lora"]
    others = [name for name in own if ".lora_" not in name]
    if others:
        raise ValueError(f"run={run} trained {', '.join(others[:3])}{', ...' if len(others) > 3 else ''}, which a LoRA "
                         "has no place for: set naming=merged.")  # fmt: skip
    content: dict[str, Tensor] = {}
    layers = set()
    for name, tensor in own.items():
        layer, _, factor = name.removesuffix(f".{adapter.ADAPTER}.weight").rpartition(".")
        layers.add(layer)
        content[f"{PREFIX[naming]}{_renamed(layer, naming)}.{factor}.weight"] = tensor.to(dtype)
    metadata = {"format": "pt", "fracgen": json.dumps(about)}
    if naming == COMFYUI and lora["alpha"] != lora["rank"]:
        content |= {f"{PREFIX[naming]}{_renamed(n, naming)}.alpha": torch.tensor(lora["alpha"]) for n in layers}
    if naming == DIFFUSERS:
        facts = {"r": lora["rank"], "lora_alpha": lora["alpha"], "target_modules": sorted(layers)}
        metadata[METADATA] = json.dumps({f"{PREFIX[naming]}{key}": value for key, value in facts.items()})
    trained.write(Path(path), content, metadata)


def _renamed(layer: str, naming: str) -> str:
    """The name of a layer of the transformer in a naming."""
    return layer if naming == DIFFUSERS else to_released(f"{layer}.weight").removesuffix(".weight")


def merge(run: Path | str, folder: Path | str, dtype: torch.dtype = torch.float32, base: str = "") -> None:
    """Write the whole model of a run, its LoRA added to the base weights in float32, in the layout of the release.

    `base` is the folder of the base weights, if not that of the training. Raises ValueError as `trained.assemble` does.
    """
    _, about = trained.read(run)
    cfg = trained.model_of(about)
    transformer = trained.assemble(run, model=replace(cfg, path=base) if base else None)
    whole = merged(transformer)
    nn.Module.to(whole, dtype)
    save_released(whole, folder)


def merged(transformer: FracTransformer) -> FracTransformer:
    """The transformer itself, with its adapters added to the weights and then taken off."""
    if getattr(transformer, "peft_config", None):
        network: Any = transformer
        network.fuse_lora(safe_fusing=True)  # which refuses what is not finite
        network.unload_lora()
    layer: Any = transformer.patch_embedding
    if parametrize.is_parametrized(layer):
        parametrize.remove_parametrizations(layer, "weight", leave_parametrized=True)
    return transformer
