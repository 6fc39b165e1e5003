"""The object's picture as the tokens of CLIP's ViT-H/14, as the base was trained with it."""

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from fracgen import weights
from fracgen.config.model import Encoders

FILE = "models_clip_open-clip-xlm-roberta-large-vit-huge-14.pth"
"""Name of the released file, which also holds a text encoder that is not needed."""
SIZES: dict[str, Any] = {"hidden_size": 1280, "intermediate_size": 5120, "num_hidden_layers": 32,
                         "num_attention_heads": 16, "image_size": 224, "patch_size": 14, "hidden_act": "gelu",
                         "layer_norm_eps": 1e-5}  # fmt: skip
"""Sizes of the released encoder, as transformers calls them."""
MEAN, STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Of the channels red, green, blue of CLIP's pictures (Radford et al. 2021)."""
_FIXED = {
    "embeddings.class_embedding": "cls_embedding", "embeddings.position_embedding.weight": "pos_embedding",
    "embeddings.patch_embedding.weight": "patch_embedding.weight",
    "pre_layrnorm.weight": "pre_norm.weight", "pre_layrnorm.bias": "pre_norm.bias",
    "post_layernorm.weight": "post_norm.weight", "post_layernorm.bias": "post_norm.bias",
}  # fmt: skip
"""Released names outside the blocks, below `visual.`, by those of transformers."""
_INSIDE = {"self_attn.out_proj": "attn.proj", "layer_norm1": "norm1", "layer_norm2": "norm2", "mlp.fc1": "mlp.0",
           "mlp.fc2": "mlp.2"}  # fmt: skip
"""The same below a block; query, key and value are one tensor there, `attn.to_qkv`."""


def table(names: Iterable[str]) -> dict[str, str]:
    """Names of transformers by the released ones; those of query, key and value end in #0, #1 and #2."""
    return {f"visual.{_released(name)}": name for name in names}


def _released(name: str) -> str:
    """The released name, below `visual.`, of a tensor that transformers calls `name`."""
    if name in _FIXED:
        return _FIXED[name]
    number, inside, kind = re.fullmatch(r"encoder\.layers\.(\d+)\.(.+)\.(weight|bias)", name).groups()  # type: ignore[union-attr]
    if inside in _INSIDE:
        return f"transformer.{number}.{_INSIDE[inside]}.{kind}"
    return f"transformer.{number}.attn.to_qkv.{kind}#{'qkv'.index(inside.removeprefix('self_attn.')[0])}"


def of_transformers(tensors: Mapping[str, Tensor], names: Iterable[str]) -> dict[str, Tensor]:
    """Tensors of either layout by the names of transformers; what belongs to the text encoder is left out."""
    if "visual.cls_embedding" not in tensors:
        return {name.removeprefix("vision_model."): value for name, value in tensors.items()
                if not name.endswith("position_ids")}  # fmt: skip
    ours = table(names)
    out: dict[str, Tensor] = {}
    for name, value in tensors.items():
        if name.endswith(("to_qkv.weight", "to_qkv.bias")):
            out |= {ours.get(f"{name}#{k}", f"{name}#{k}"): part for k, part in enumerate(value.chunk(3))}
        elif name in ("visual.cls_embedding", "visual.pos_embedding"):
            out[ours[name]] = value.flatten() if name == "visual.cls_embedding" else value[0]
        elif name.startswith("visual.") and name != "visual.head":
            out[ours.get(name, name)] = value
    return out


def of_released(tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors by the names of transformers as those of the released file, without its text encoder and head."""
    theirs = {name: tensors[ours] for name, ours in table(tensors).items()}
    for name in [name for name in theirs if name.endswith("#0")]:
        theirs[name[:-2]] = torch.cat([theirs.pop(f"{name[:-1]}{k}") for k in range(3)])
    for name in ("visual.cls_embedding", "visual.pos_embedding"):
        theirs[name] = theirs[name].reshape(1, -1, theirs[name].shape[-1])
    return theirs


def network(sizes: Mapping[str, Any]) -> Any:
    """A CLIPVisionModel with these sizes on the meta device."""
    from transformers import CLIPVisionConfig, CLIPVisionModel

    with torch.device("meta"):
        return CLIPVisionModel(CLIPVisionConfig(**sizes))


def fill(net: Any, tensors: Mapping[str, Tensor], source: Path | str) -> None:
    """Give a network on the meta device its weights, of either layout; raises ValueError for those that do not fit."""
    weights.fit(net, of_transformers(tensors, net.state_dict()), source)
    places = net.embeddings.position_embedding.num_embeddings
    net.embeddings.position_ids = torch.arange(places)[None]  # not among the weights


def find(cfg: Encoders) -> tuple[Path, dict[str, Any]]:
    """The file of weights and the sizes; raises ValueError when it is missing."""
    path = Path(cfg.image_path).expanduser()
    if cfg.image_path and path.is_file():
        return path, SIZES
    for folder in (path, path / "image_encoder"):
        if cfg.image_path and (folder / FILE).is_file():
            return folder / FILE, SIZES
        files = sorted(folder.glob("*.safetensors"))
        if cfg.image_path and len(files) == 1 and (folder / "config.json").is_file():
            config = json.loads((folder / "config.json").read_text(encoding="utf-8"))
            config = config.get("vision_config", config)
            return files[0], {key: config.get(key, value) for key, value in SIZES.items()}
    raise ValueError(
        f"encoders.image_path={cfg.image_path} holds no CLIP: give {FILE} or its folder, or a folder with "
        "image_encoder/; encoders.image=zeros needs no weights."
    )


def image_identity(cfg: Encoders) -> str:
    """The identity of `image(cfg)` without loading a network, "zeros" where there is none; raises ValueError."""
    if cfg.image == "zeros":
        return "zeros"
    file, sizes = find(cfg)
    return weights.digest_files([file], sizes)


def image(cfg: Encoders, device: torch.device | str = "cpu") -> "ImageEncoder | None":
    """The encoder of pictures, None for `image=zeros`; raises ValueError for weights that are missing or do not fit."""
    if cfg.image == "zeros":
        return None
    file, sizes = find(cfg)
    net = network(sizes)
    fill(net, weights.read(file), file)
    return ImageEncoder(net.float().to(device).eval(), image_identity(cfg))


class ImageEncoder:
    """Pictures as the tokens of CLIP's last block but one."""

    def __init__(self, net: Any, name: str) -> None:
        self.network = net
        self.identity = name

    @torch.no_grad()
    def encode(self, rgb: Tensor) -> Tensor:
        """Tokens [B, 257, 1280] float32 on the CPU of pictures [B, H, W, 3] uint8; raises ValueError for others."""
        if rgb.dtype != torch.uint8 or rgb.ndim != 4 or rgb.shape[-1] != 3:
            raise ValueError(f"rgb: {rgb.dtype} {list(rgb.shape)} must be uint8 [pictures, rows, columns, 3].")
        pixels = prepare(rgb, self.network.config.image_size).to(self.network.device, self.network.dtype)
        tokens: Tensor = self.network(pixels, output_hidden_states=True).hidden_states[-2]
        return tokens.float().cpu()


def prepare(rgb: Tensor, size: int) -> Tensor:
    """Pictures [B, H, W, 3] uint8 as CLIP gets them, [B, 3, size, size] float32.

    They are squeezed into the square by cubic interpolation without a filter before it, as in the base's training
    (`CLIPModel.forward` of Wan2.1), and have CLIP's mean and deviation removed.
    """
    pixels = rgb.movedim(-1, 1).float() / 255
    pixels = functional.interpolate(pixels, size=(size, size), mode="bicubic", align_corners=False)
    mean, std = (torch.tensor(v, device=rgb.device).reshape(1, 3, 1, 1) for v in (MEAN, STD))
    return (pixels - mean) / std
