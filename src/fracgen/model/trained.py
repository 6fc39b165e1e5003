"""What a training has made, as a file: the trained tensors, and what identifies the base that they belong to.

A file is in safetensors format with JSON in its metadata. Tensors of the transformer begin with `transformer.`, those
of the constitutive maps with `constitutive.`.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from fracgen.config.model import Lora, Model
from fracgen.model import adapter
from fracgen.model.base import base_identity, build
from fracgen.model.transformer import FracTransformer

VERSION = 1
"""Version of the format."""
FILE = "trained.safetensors"
"""Name of the file in the folder of a run."""
TRANSFORMER, CONSTITUTIVE = "transformer", "constitutive"
"""Whose tensors they are: what their names begin with."""
ABOUT = ("version", "stage", "streams", "model", "base", "scalars", "conditioning", "config")
"""What a file says about itself."""


def state(transformer: nn.Module) -> dict[str, Tensor]:
    """The trained tensors of a transformer by name; views, on its device."""
    return {name: parameter.detach() for name, parameter in adapter.trained(transformer)}


def save(path: Path | str, tensors: Mapping[str, Tensor], about: Mapping[str, Any]) -> None:
    """Write a file at once: it is complete or not there. Adds the version to `about`."""
    write(Path(path), tensors, {"about": json.dumps({**about, "version": VERSION})})


def write(path: Path, tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> None:
    """Write a safetensors file that is complete or not there, with the rights that any new file gets."""
    content = {name: tensor.detach().cpu().contiguous().clone() for name, tensor in tensors.items()}
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        unfinished.touch()
        rights = unfinished.stat().st_mode
        save_file(content, unfinished, dict(metadata))  # for the owner alone
        unfinished.chmod(rights)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def find(path: Path | str) -> Path:
    """The file of a run, given the file or the folder; raises ValueError if there is none."""
    given = Path(path).expanduser()
    out = given / FILE if given.is_dir() else given
    if not out.is_file():
        raise ValueError(
            f"run={path} has no {FILE}: give the folder of a finished training, as runs/stage3-0123456789."
        )
    return out


def read(path: Path | str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors, on the CPU, and what the file says about itself; `path` is the file or the folder of a run.

    Raises ValueError for a file that is missing, damaged, foreign or of an unknown version.
    """
    file = find(path)
    try:
        with safe_open(file, framework="pt", device="cpu") as content:
            text = (content.metadata() or {}).get("about", "null")
            tensors = {name: content.get_tensor(name) for name in content.keys()}  # noqa: SIM118
        about = json.loads(text)
    except (SafetensorError, ValueError) as error:
        raise ValueError(f"run={file} cannot be read ({error}): the file is damaged; copy it again or train again."
                         ) from None  # fmt: skip
    if not isinstance(about, dict) or "version" not in about:
        raise ValueError(f"run={file} was not written by fracgen.train: give the folder of a run; LoRA files of others "
                         "are read by fracgen.model.export.load_lora.")  # fmt: skip
    if about["version"] != VERSION:
        raise ValueError(f"run={file} has format version {about['version']}, but this program reads version {VERSION}: "
                         "use the release that wrote it.")  # fmt: skip
    missing = [name for name in ABOUT if name not in about]
    if missing:
        raise ValueError(f"run={file} does not say its {', '.join(missing)}: the file is incomplete; train again.")
    return tensors, about


def part(tensors: Mapping[str, Tensor], owner: str) -> dict[str, Tensor]:
    """The tensors of `owner` (TRANSFORMER or CONSTITUTIVE), without the owner's name in theirs."""
    return {n.removeprefix(f"{owner}."): t for n, t in tensors.items() if n.startswith(f"{owner}.")}


def check_base(about: Mapping[str, Any], base: str, path: Path | str) -> None:
    """Raise ValueError if the tensors of `path` belong to other base weights than `base` (a base_identity)."""
    if about["base"] != base:
        raise ValueError(f"run={path} belongs to base weights {about['base']}, but the model has {base}: set "
                         f"model.path to those it was trained on (model.path={about['model'].get('path')!r} then), "
                         "or train again.")  # fmt: skip


def check_stage(about: Mapping[str, Any], stage: int, path: Path | str) -> None:
    """Raise ValueError if `path` is of another stage than `stage`."""
    if about["stage"] != stage:
        raise ValueError(f"init_from={path} is a run of stage {about['stage']}, but stage {stage} is wanted: give a "
                         f"run of stage {stage}, or init_from=none to start from the base.")  # fmt: skip


def apply(transformer: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Put `tensors`, named as by `state`, into a transformer that has been prepared like the one they come from.

    Raises ValueError naming tensors that are missing, too many or of another shape; then nothing has changed.
    """
    own = dict(adapter.trained(transformer))
    faults = {
        "missing": [n for n in own if n not in tensors],
        "too many": [n for n in tensors if n not in own],
        "of another shape": [
            f"{n} {list(tensors[n].shape)} instead of {list(own[n].shape)}"
            for n in own
            if n in tensors and own[n].shape != tensors[n].shape
        ],
    }
    told = [f"{len(names)} {kind}: {', '.join(names[:3])}{', ...' if len(names) > 3 else ''}"
            for kind, names in faults.items() if names]  # fmt: skip
    if told:
        raise ValueError(f"trained weights do not fit the model ({'; '.join(told)}): set model.train, "
                         "model.train_patch_embed, model.rope and model.lora as in the training.")  # fmt: skip
    with torch.no_grad():
        for name, parameter in own.items():
            parameter.copy_(tensors[name])


def model_of(about: Mapping[str, Any]) -> Model:
    """The configuration of the transformer that a file belongs to; raises ValueError for fields that do not exist."""
    content = dict(about["model"])
    unknown = set(content) - {f.name for f in fields(Model)}
    if unknown:
        raise ValueError(f"the run names unknown fields of the model ({', '.join(sorted(unknown))}): use the release "
                         "that wrote it.")  # fmt: skip
    return Model(**{**content, "lora": Lora(**content["lora"])})


def assemble(
    path: Path | str, device: str = "cpu", dtype: torch.dtype = torch.float32, model: Model | None = None
) -> FracTransformer:
    """The transformer of a run, ready to sample: base, adapters, trained tensors, in eval mode.

    `model` overrides what the run says about its base, as when the weights lie elsewhere. Raises ValueError if the
    run cannot be read, belongs to other base weights, or does not fit.
    """
    tensors, about = read(path)
    cfg = model or model_of(about)
    check_base(about, base_identity(cfg), path)
    transformer = build(cfg, about["streams"], device, dtype)
    types = {name: parameter.dtype for name, parameter in transformer.named_parameters()}
    adapter.prepare(transformer, cfg)
    apply(transformer, part(tensors, TRANSFORMER))
    for name, parameter in adapter.trained(transformer):  # training keeps them in float32, sampling need not
        parameter.data = parameter.data.to(types.get(name, dtype))
    return transformer.eval()
