"""Sizes of the transformer: as the config gives them, and as the config.json of a checkpoint states them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fracgen.config.model import Model


def sizes(cfg: Model) -> dict[str, int | None]:
    """The sizes that `FracTransformer` takes, by its argument."""
    return {
        "num_attention_heads": cfg.heads, "attention_head_dim": cfg.head_dim, "ffn_dim": cfg.ffn_dim,
        "num_layers": cfg.layers, "text_dim": cfg.text_dim, "image_dim": cfg.image_dim or None,
    }  # fmt: skip


def check_config(file: Path, cfg: Model) -> None:
    """Raise ValueError naming each field of `cfg` that differs from the config.json of a checkpoint, and both values.

    A file that is not there, and sizes that it does not state, are left to the shapes of the tensors.
    """
    if not file.exists():
        return
    try:
        stated = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f"model.path: {file} cannot be read ({error}): fetch it again.") from None
    stated = stated if isinstance(stated, dict) else {}
    wrong = [
        f"model.{field}={getattr(cfg, field)}, but {name}={value}: set model.{field}={value}"
        for field, (name, value) in _stated(stated).items()
        if value != getattr(cfg, field)
    ]
    if wrong:
        raise ValueError(f"model.path: {file} has other sizes. {'; '.join(wrong)}.")


def _stated(config: Mapping[str, Any]) -> dict[str, tuple[str, int]]:
    """Field of `Model` to the name and value in a config.json of either layout."""
    names = {"layers": "num_layers", "ffn_dim": "ffn_dim", "text_dim": "text_dim"}
    if "num_attention_heads" in config:
        names |= {"heads": "num_attention_heads", "head_dim": "attention_head_dim", "image_dim": "image_dim"}
    else:
        names |= {"heads": "num_heads", "head_dim": "dim / num_heads"}
    values = dict(config)
    if config.get("num_heads") and "dim" in config:
        values["dim / num_heads"] = config["dim"] // config["num_heads"]
    return {field: (name, values[name] or 0) for field, name in names.items() if name in values}
