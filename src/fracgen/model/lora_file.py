"""A LoRA from a file of ours or of others: names of diffusers, peft, ComfyUI or DiffSynth, told apart by themselves."""

import json
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from peft import LoraConfig
from safetensors import SafetensorError, safe_open
from torch import Tensor, nn

from fracgen.model import FracTransformer, adapter
from fracgen.model.export import METADATA
from fracgen.model.released import to_diffusers

LOADED = "loaded"
"""Name of an adapter from a file."""
KEY = re.compile(
    r"(transformer\.|diffusion_model\.|)(.+)\.(?:(alpha)|(?:(lora_A|lora_B|lora_down|lora_up)(?:\.default)?\.weight))"
)
"""Prefix, layer and part of a name."""
PART = {"lora_down": "lora_A", "lora_up": "lora_B"}
"""Parts that have two names."""


class Layer(NamedTuple):
    """One layer's update: alpha / rank times B A, with A [rank, in] and B [out, rank]."""

    A: Tensor
    B: Tensor
    alpha: float


def load_lora(transformer: FracTransformer, path: Path | str, name: str = LOADED) -> None:
    """Add the LoRA in a file to those that are active; it is frozen, and what is trained stays trained.

    Warns of a LoRA that changes nothing. Raises ValueError for a file that cannot be read or is none, and for layers
    that the transformer does not have or that have another size.
    """
    layers = read(path)
    _check(transformer, layers, path)
    adapters = getattr(transformer, "peft_config", None) or {}
    if name in adapters:
        raise ValueError(f"lora={path}: the transformer has an adapter {name} already: give this one another name.")
    active = list(transformer.active_adapters()) if adapters else []
    moving = {id(parameter) for _, parameter in adapter.trained(transformer)}
    adapter.inject(transformer, _config(layers), name)
    own = dict(transformer.named_parameters())
    for layer, update in layers.items():
        for factor, value in (("lora_A", update.A), ("lora_B", update.B)):
            parameter = own[f"{layer}.{factor}.{name}.weight"]
            parameter.data = value.to(parameter.device)
    transformer.set_adapter([*active, name])
    for parameter in own.values():  # peft trains whatever is active, and nothing else
        parameter.requires_grad_(id(parameter) in moving)
    if adapter.is_zero(transformer, name):
        warnings.warn(f"lora={path} changes nothing: all its lora_B are 0.", stacklevel=2)


def read(path: Path | str) -> dict[str, Layer]:
    """The updates in a file by layer, as diffusers names it; alpha is the rank where the file does not say it.

    Raises ValueError for a file that cannot be read, that holds no LoRA or something else beside it, or half of one.
    """
    try:
        with safe_open(Path(path).expanduser(), framework="pt", device="cpu") as content:
            tensors = {key: content.get_tensor(key) for key in content.keys()}  # noqa: SIM118
            facts = json.loads((content.metadata() or {}).get(METADATA, "{}"))
    except (OSError, SafetensorError, ValueError) as error:
        raise ValueError(f"lora={path} cannot be read ({error}): give a .safetensors file.") from None
    parts: dict[str, dict[str, Tensor]] = {}
    prefix = ""
    for key, tensor in tensors.items():
        found = KEY.fullmatch(key)
        if found is None:
            raise ValueError(f"lora={path} holds {key}, which is no part of a LoRA: its names end in lora_A.weight, "
                             "lora_B.weight, lora_down.weight, lora_up.weight or alpha.")  # fmt: skip
        prefix, layer, part = found[1], found[2], found[3] or found[4]
        named = to_diffusers(f"{layer}.weight").removesuffix(".weight")
        parts.setdefault(named, {})[PART.get(part, part)] = tensor
    alpha = facts.get(f"{prefix}lora_alpha")
    return {layer: _layer(layer, part, alpha, path) for layer, part in parts.items()}


def _layer(name: str, part: Mapping[str, Tensor], alpha: float | None, path: Path | str) -> Layer:
    """The update of one layer; raises ValueError for half of one."""
    if not {"lora_A", "lora_B"} <= part.keys():
        raise ValueError(f"lora={path} holds {', '.join(part)} of {name} only: it needs lora_A and lora_B.")
    rank = part["lora_A"].shape[0]
    own = float(part["alpha"]) if "alpha" in part else rank if alpha is None else alpha
    return Layer(part["lora_A"], part["lora_B"], own)


def _check(transformer: nn.Module, layers: Mapping[str, Layer], path: Path | str) -> None:
    """Raise ValueError unless the transformer has linear layers of these names and sizes."""
    modules = dict(transformer.named_modules())
    faults = [] if layers else ["it is empty"]
    for name, update in layers.items():
        module: Any = modules.get(f"{name}.base_layer", modules.get(name))
        if not isinstance(module, nn.Linear):
            faults.append(f"{name} is no linear layer of it")
        elif update.A.shape != (len(update.A), module.in_features) or update.B.shape != (
            module.out_features, len(update.A),
        ):  # fmt: skip
            faults.append(f"{name} has {module.in_features} inputs and {module.out_features} outputs, the file "
                          f"{list(update.A.shape)} and {list(update.B.shape)}")  # fmt: skip
    if faults:
        raise ValueError(f"lora={path} does not fit the transformer: {'; '.join(faults[:3])}"
                         f"{'; ...' if len(faults) > 3 else ''}. Give a LoRA of this model.")  # fmt: skip


def _config(layers: Mapping[str, Layer]) -> LoraConfig:
    """What peft needs to make room for updates."""
    first = next(iter(layers.values()))
    config: Any = LoraConfig
    out: LoraConfig = config(
        r=len(first.A), lora_alpha=first.alpha, target_modules=list(layers),
        rank_pattern={n: len(u.A) for n, u in layers.items() if len(u.A) != len(first.A)},
        alpha_pattern={n: u.alpha for n, u in layers.items() if u.alpha != first.alpha},
    )  # fmt: skip
    return out
