"""The base: a transformer with the weights of a checkpoint, or with random ones."""

import hashlib
import json
from collections.abc import Sequence

import torch

from fracgen.config.model import Model
from fracgen.model.files import digest, folder, weight_files
from fracgen.model.load import keeps_float32, load
from fracgen.model.rope import JointRope
from fracgen.model.sizes import check_config, sizes
from fracgen.model.transformer import FracTransformer


def build(
    cfg: Model, streams: Sequence[str], device: str | torch.device = "cpu", dtype: torch.dtype = torch.float32
) -> FracTransformer:
    """The transformer of `cfg` for `streams`, with its base weights; nothing is frozen yet, and it is in eval mode.

    Weights come from `cfg.path`, or are random by `cfg.seed`, the same for any streams. They get `dtype`, those that
    diffusers keeps in float32 (norms, embedding of the timestep, modulation) float32. Raises ValueError for files that
    are not there or do not fit, naming fields and tensors.
    """
    if not cfg.path:
        return _random(cfg, streams, torch.device(device), dtype).eval()
    place = folder(cfg)
    files = weight_files(place)
    check_config(place / "config.json", cfg)
    transformer = empty(cfg, streams)
    load(transformer, files, torch.device(device), dtype)
    transformer.rope = JointRope(cfg.head_dim, len(transformer.streams), cfg.rope).to(device)
    return transformer.eval()


def empty(cfg: Model, streams: Sequence[str]) -> FracTransformer:
    """The transformer of `cfg` on the meta device, without memory: for shapes and counts."""
    with torch.device("meta"):
        transformer: FracTransformer = FracTransformer(streams, cfg.rope, **sizes(cfg))
    return transformer


def _random(cfg: Model, streams: Sequence[str], device: torch.device, dtype: torch.dtype) -> FracTransformer:
    """PyTorch's initial weights by `cfg.seed`; the random state of the process is left alone."""
    with torch.random.fork_rng(devices=[]), torch.device("cpu"):
        torch.manual_seed(cfg.seed)
        transformer: FracTransformer = FracTransformer(streams, cfg.rope, **sizes(cfg))
    for name, parameter in transformer.named_parameters():
        kind = torch.float32 if keeps_float32(transformer, name) else dtype
        parameter.data = parameter.data.to(device, kind)
    transformer.rope.to(device)
    return transformer


def base_identity(cfg: Model) -> str:
    """12 hex digits over the files of the base weights, or "random-SEED-HASH" with a hash of the sizes."""
    if cfg.path:
        return digest(weight_files(folder(cfg)))
    text = json.dumps(sizes(cfg), sort_keys=True)
    return f"random-{cfg.seed}-{hashlib.blake2b(text.encode(), digest_size=6).hexdigest()}"
