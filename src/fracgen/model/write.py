"""A transformer as a checkpoint in the released layout."""

import json
import os
from pathlib import Path
from typing import Any

from safetensors.torch import save_file

from fracgen.model.context import TEXT_TOKENS
from fracgen.model.files import STEM
from fracgen.model.released import to_released
from fracgen.model.transformer import IN_CHANNELS, FracTransformer


def save_released(transformer: FracTransformer, folder: Path | str) -> None:
    """Write the weights and config.json of a transformer without adapters, as the base was released.

    (`save_pretrained` of diffusers writes diffusers' layout.) Raises ValueError if it has adapters.
    """
    if getattr(transformer, "peft_config", None):
        raise ValueError("the transformer has adapters, which the released layout has no place for: export them alone, "
                         "or merge them first.")  # fmt: skip
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    tensors = {to_released(name): value.detach().contiguous() for name, value in transformer.state_dict().items()}
    weights, config = place / f"{STEM}.safetensors", place / "config.json"
    save_file(tensors, f"{weights}.part", metadata={"format": "pt"})
    Path(f"{config}.part").write_text(json.dumps(_config(transformer), indent=2) + "\n", encoding="utf-8")
    os.replace(f"{config}.part", config)
    os.replace(f"{weights}.part", weights)


def _config(transformer: FracTransformer) -> dict[str, Any]:
    """config.json in the words of the released checkpoint."""
    c: Any = transformer.config
    return {
        "_class_name": "WanModel", "model_type": "i2v" if c.image_dim else "t2v", "in_dim": IN_CHANNELS,
        "out_dim": c.out_channels, "dim": c.num_attention_heads * c.attention_head_dim, "ffn_dim": c.ffn_dim,
        "freq_dim": c.freq_dim, "text_dim": c.text_dim, "text_len": TEXT_TOKENS, "num_heads": c.num_attention_heads,
        "num_layers": c.num_layers, "eps": c.eps, "add_ref_conv": True, "in_dim_ref_conv": c.out_channels,
    }  # fmt: skip
