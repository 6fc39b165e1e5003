"""What shapes the weights of a run, and its hash: equal trainings share a folder, whatever label and machine."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from fracgen.config.train import Recipe, TrainConfig
from fracgen.data import LatentCache
from fracgen.layout import STREAMS

SOURCE = ("path", "hub", "seed")
"""Fields of the model that say where weights come from; what they are is in the identity of the base."""
SHAPING = ("precision", "base_dtype", "effective_batch", "optimizer", "weight_decay", "clip", "ema")
"""Fields of the trainer that shape weights; the others change speed and memory only."""
CONSTITUTIVE = ("lambda_const", "ramp", "lame", "weight", "gate", "detach_stress", "const_lr")
"""Fields of the loss that only a stage with the constitutive loss reads."""


def recipe_of(cfg: TrainConfig, stage: int) -> Recipe:
    """The recipe of a stage."""
    recipe = getattr(cfg.stages, f"stage{stage}")
    assert isinstance(recipe, Recipe)
    return recipe


def content(cfg: TrainConfig, stage: int, base: str, clips: str, parent: str) -> dict[str, Any]:
    """All that shapes the weights of a stage: its configuration, and the ids of base weights, clips and parent run."""
    recipe = recipe_of(cfg, stage)
    loss = asdict(cfg.loss)
    if not recipe.constitutive:
        loss = {name: value for name, value in loss.items() if name not in CONSTITUTIVE}
    weights = dict(zip(STREAMS, loss.pop("map_weights"), strict=True))
    loss["map_weights"] = {name: weights[name] for name in recipe.streams} if len(recipe.streams) > 1 else {}
    return {
        "stage": stage,
        "base": base,
        "data": clips,
        "parent": parent,
        "seed": cfg.seed,
        "model": {name: value for name, value in asdict(cfg.model).items() if name not in SOURCE},
        "conditioning": asdict(cfg.conditioning),
        "loss": loss,
        "recipe": asdict(recipe),
        "trainer": {name: getattr(cfg.trainer, name) for name in SHAPING},
    }


def digest(content: Mapping[str, Any]) -> str:
    """12 hex digits over a mapping."""
    text = json.dumps(content, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=6).hexdigest()


def of_clips(cache: LatentCache, numbers: list[int]) -> str:
    """12 hex digits over how a cache was made and the training clips with these numbers in it."""
    rows = [cache.rows[k] for k in numbers]
    about = {name: value for name, value in cache.about.items() if name != "streams"}  # a map more changes no latent
    return digest(
        {"cache": about, "clips": [[k, row["id"], row["sha256"]] for k, row in zip(numbers, rows, strict=True)]}
    )


def differences(mine: Mapping[str, Any], other: Mapping[str, Any], name: str = "") -> Iterator[str]:
    """What is different in two contents, as `loss.shift=5.0 (there 1.0)`."""
    for key in [*mine, *(k for k in other if k not in mine)]:
        a, b = mine.get(key), other.get(key)
        dotted = f"{name}.{key}" if name else key
        if isinstance(a, Mapping) and isinstance(b, Mapping):
            yield from differences(a, b, dotted)
        elif a != b:
            yield f"{dotted}={a} (there {b})"
