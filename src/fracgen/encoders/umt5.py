"""UMT5 as the base was trained with it: masked, cut at the end of the caption; released or transformers layout."""

import html
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from fracgen import weights
from fracgen.config.model import Encoders

FILE, TOKENIZER = "models_t5_umt5-xxl-enc-bf16.pth", "google/umt5-xxl"
"""Released layout."""
SIZES: dict[str, int] = {"d_model": 4096, "d_ff": 10240, "d_kv": 64, "num_heads": 64, "num_layers": 24,
                         "vocab_size": 256384}  # fmt: skip
"""Sizes of the released encoder, which has no config of its own, as transformers calls them."""
SHARED = "encoder.embed_tokens.weight"
"""Second name of the embedding of tokens."""
_INSIDE = {
    "layer.0.layer_norm": "norm1", "layer.1.layer_norm": "norm2",
    **{f"layer.0.SelfAttention.{part}": f"attn.{part}" for part in "qkvo"},
    "layer.0.SelfAttention.relative_attention_bias": "pos_embedding.embedding",
    "layer.1.DenseReluDense.wi_0": "ffn.gate.0", "layer.1.DenseReluDense.wi_1": "ffn.fc1",
    "layer.1.DenseReluDense.wo": "ffn.fc2",
}  # fmt: skip
"""Released names below a block by those of transformers."""


def released(name: str) -> str:
    """The released name of a tensor that transformers calls `name`."""
    fixed = {"shared.weight": "token_embedding.weight", "encoder.final_layer_norm.weight": "norm.weight"}
    if name in fixed:
        return fixed[name]
    number, _, inside = name.removeprefix("encoder.block.").removesuffix(".weight").partition(".")
    return f"blocks.{number}.{_INSIDE[inside]}.weight"


def table(names: Iterable[str]) -> dict[str, str]:
    """Names of transformers by the released ones; the tied second name of the embedding has none."""
    return {released(name): name for name in names if name != SHARED}


def network(sizes: Mapping[str, Any]) -> Any:
    """A UMT5EncoderModel with these sizes on the meta device."""
    from transformers import UMT5Config, UMT5EncoderModel

    # UMT5 has gated GELU in its tanh form, and 32 distances, as the defaults of UMT5Config.
    with torch.device("meta"):
        return UMT5EncoderModel(UMT5Config(**{"feed_forward_proj": "gated-gelu", **sizes}))


def find(cfg: Encoders) -> tuple[list[Path], Path, dict[str, Any] | None]:
    """Files of weights, folder of the tokenizer, and config (None in the released layout).

    Raises ValueError when one is missing.
    """
    root = Path(cfg.text_path).expanduser()
    if cfg.text_path and (root / FILE).is_file() and (root / TOKENIZER).is_dir():
        return [root / FILE], root / TOKENIZER, None
    for folder, tokenizer in ((root / "text_encoder", root / "tokenizer"), (root, root)):
        files = sorted(folder.glob("*.safetensors"))
        config = folder / "config.json"
        if cfg.text_path and files and config.is_file() and (tokenizer / "tokenizer_config.json").is_file():
            return files, tokenizer, json.loads(config.read_text(encoding="utf-8"))
    raise ValueError(
        f"encoders.text_path={cfg.text_path} holds no UMT5: give a folder with {FILE} and {TOKENIZER}/, or with "
        "text_encoder/ and tokenizer/; encoders.text=words needs no weights."
    )


def identity(cfg: Encoders) -> str:
    """12 hex digits over weights and tokenizer; raises ValueError when they are missing."""
    files, tokenizer, config = find(cfg)
    return weights.digest_files([*files, *(p for p in tokenizer.iterdir() if p.is_file())], config)


def load(cfg: Encoders, dim: int, tokens: int, device: torch.device | str) -> "Umt5":
    """The encoder; raises ValueError for weights that are missing or do not fit, or are not `dim` wide."""
    from transformers import AutoTokenizer

    files, tokenizer, config = find(cfg)
    sizes = SIZES if config is None else {key: value for key, value in config.items() if key in (*SIZES,
            "feed_forward_proj", "relative_attention_num_buckets", "relative_attention_max_distance")}  # fmt: skip
    if sizes.get("d_model") != dim:
        raise ValueError(f"encoders.text_path={cfg.text_path} has {sizes.get('d_model')} channels, but model.text_dim="
                         f"{dim}: set model.text_dim={sizes.get('d_model')}, or encoders.text=words.")  # fmt: skip
    net = network(sizes)
    fill(net, {name: value for file in files for name, value in weights.read(file).items()}, files[0])
    return Umt5(net.to(device).eval(), AutoTokenizer.from_pretrained(tokenizer), tokens, identity(cfg))


def fill(net: Any, tensors: Mapping[str, Tensor], source: Path | str) -> None:
    """Give a network on the meta device its weights, of either layout; raises ValueError for those that do not fit."""
    ours = table(net.state_dict())
    named = {ours.get(name, name): value for name, value in tensors.items()}
    if "shared.weight" in named:
        named[SHARED] = named["shared.weight"]  # one tensor: a copy that stayed zero would void every caption
    elif SHARED in named:
        named["shared.weight"] = named[SHARED]
    weights.fit(net, named, source)
    net.tie_weights()
    if net.shared.weight is not net.encoder.embed_tokens.weight or not bool(net.shared.weight.any()):
        raise ValueError(f"{source}: the embedding of tokens is zero or not tied; install another transformers.")


class Umt5:
    """Captions as UMT5 embeds them."""

    def __init__(self, net: Any, tokenizer: Any, tokens: int, name: str) -> None:
        self.network, self._tokenizer, self._tokens = net, tokenizer, tokens
        self.identity = name

    @torch.no_grad()
    def encode(self, captions: list[str]) -> list[Tensor]:
        """Embeddings [n, dim] float32 on the CPU of cleaned captions, each cut at its end (its end token included)."""
        batch = self._tokenizer([clean(c) for c in captions], padding="longest", truncation=True,
                                max_length=self._tokens, add_special_tokens=True, return_tensors="pt")  # fmt: skip
        ids, mask = (batch[key].to(self.network.device) for key in ("input_ids", "attention_mask"))
        out = self.network(input_ids=ids, attention_mask=mask).last_hidden_state.float().cpu()
        return [row[: int(n)].clone() for row, n in zip(out, mask.sum(dim=1), strict=True)]


def clean(caption: str) -> str:
    """A caption with entities of HTML resolved, and one blank between words, as the base's captions were cleaned.

    The base also repairs wrongly decoded Unicode; the captions of fracsim are ASCII, which that leaves as it is.
    """
    return " ".join(html.unescape(html.unescape(caption)).split())
