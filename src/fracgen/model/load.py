"""Weights of a checkpoint into a transformer: mapped from the files, tensor by tensor, without a second copy."""

from collections.abc import Iterable, Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import Tensor

from fracgen.model.released import to_diffusers
from fracgen.model.transformer import FracTransformer

NAMED = 5
"""So many tensors of a list are named in an error."""


def load(transformer: FracTransformer, files: Iterable[Path], device: torch.device, dtype: torch.dtype) -> None:
    """Put the tensors of safetensors files, in released or diffusers layout, into a transformer on the meta device.

    They get `dtype`, those in `_keep_in_fp32_modules` float32. Raises ValueError naming missing, extra and misshapen
    tensors.
    """
    tensors: dict[str, Tensor] = {}
    for file in files:
        tensors |= _read(file, transformer, device, dtype)
    wanted = {name: tuple(value.shape) for name, value in transformer.state_dict().items()}
    if "map_embed" in wanted and "map_embed" not in tensors:  # ours; a base has none
        tensors["map_embed"] = torch.zeros(wanted["map_embed"], device=device)
    _compare(wanted, tensors)
    transformer.load_state_dict(tensors, assign=True)


def keeps_float32(transformer: FracTransformer, name: str) -> bool:
    """Whether the tensor called `name` stays float32 whatever the type of the others."""
    parts = name.split(".")
    return any(module in parts for module in transformer._keep_in_fp32_modules)


def _read(file: Path, transformer: FracTransformer, device: torch.device, dtype: torch.dtype) -> dict[str, Tensor]:
    """The tensors of a file by their names in diffusers, on their device and in their type."""
    out = {}
    try:
        with safe_open(file, framework="pt", device=str(device)) as content:
            names = list(content.keys())
            for name in names:
                ours = to_diffusers(name)
                kind = torch.float32 if keeps_float32(transformer, ours) else dtype
                out[ours] = content.get_tensor(name).to(kind)
    except (OSError, SafetensorError) as error:
        raise ValueError(f"model.path: {file} cannot be read ({error}): fetch it again.") from None
    return out


def _compare(wanted: Mapping[str, tuple[int, ...]], tensors: Mapping[str, Tensor]) -> None:
    """Raise one ValueError that names what is missing, extra and misshapen."""
    if "ref_conv.weight" not in tensors and "patch_embedding.weight" in tensors:
        raise ValueError("model.path: the checkpoint has no ref_conv, which reads the reference picture, so it is not "
                         "Wan2.1-Fun-V1.1-Control: set model.path to a checkpoint of V1.1.")  # fmt: skip
    both = wanted.keys() & tensors.keys()
    faults = {
        "missing": sorted(wanted.keys() - both),
        "extra": sorted(tensors.keys() - both),
        "misshapen": [
            f"{n} {tuple(tensors[n].shape)} for {wanted[n]}"
            for n in sorted(both)
            if tuple(tensors[n].shape) != wanted[n]
        ],
    }
    if any(faults.values()):
        text = "; ".join(f"{len(names)} {kind}: {_some(names)}" for kind, names in faults.items() if names)
        raise ValueError(f"model.path: the tensors do not fit model.* ({text}): give the checkpoint of these sizes, in "
                         "released or diffusers layout, or set the sizes of this one.")  # fmt: skip


def _some(names: list[str]) -> str:
    return ", ".join(names[:NAMED]) + (", ..." if len(names) > NAMED else "")
