"""Trainings that are measured: two sizes of the transformer, a batch of random latents, the module of a stage."""

from dataclasses import replace

import torch

from fracgen.conditioning import SCALARS
from fracgen.config.model import Lora, Model, Vae
from fracgen.config.train import Recipe, TrainConfig, Trainer
from fracgen.data import Batch
from fracgen.layout import CHANNELS, STREAMS
from fracgen.memory.size import IMAGE_TOKENS, TEXT_TOKENS, Size
from fracgen.train import TRAIN
from fracgen.training import network
from fracgen.training.module import Module

MODELS = {
    "tiny": Model(layers=4, heads=4, head_dim=32, ffn_dim=512, text_dim=64, image_dim=0, train="full"),
    "mid": Model(
        layers=6, heads=6, head_dim=64, ffn_dim=2048, text_dim=128, image_dim=96, lora=Lora(rank=16, alpha=16)
    ),
}
"""All weights trained, and adapters on a frozen base."""
SIZES = {"tiny": Size(64, 64, 17, 5), "mid": Size(96, 96, 17, 5)}
"""480 and 1080 tokens."""
MODES = ("none", "selective", "full")


def small_vae(path: str = "", tile: int = 0) -> Vae:
    """The configuration of vae=tiny; without a `path` its weights are random."""
    return replace(TRAIN.compose("model=tiny", "vae=tiny").vae, path=path, tile=tile)


def config(model: Model, checkpointing: str = "none", precision: str = "32-true") -> TrainConfig:
    """A training of a model on one device."""
    base = "float32" if precision == "32-true" else "bfloat16"
    trainer = Trainer(checkpointing=checkpointing, precision=precision, base_dtype=base, devices=1, effective_batch=2)
    return TrainConfig(model=model, trainer=trainer)


def streams_of(size: Size) -> tuple[str, ...]:
    """The first streams, as many as the size has."""
    return STREAMS[: size.streams]


def module(cfg: TrainConfig, size: Size, device: str = "cpu") -> Module:
    """The module of a stage, with the constitutive loss where all streams are there, ready to run on a device."""
    streams = streams_of(size)
    recipe = Recipe(streams=list(streams), constitutive=len(streams) == len(STREAMS))
    out = Module(cfg, recipe, network.build(cfg, streams), total=1000).to(device)
    network.settle(out.transformer, cfg, size.tokens)
    return out


def batch(cfg: Model, size: Size, device: str = "cpu") -> Batch:
    """A batch of normal numbers; the keys of random draws stay on the CPU."""
    frames, rows, columns = size.latent
    one = (size.batch, CHANNELS, frames, rows // size.streams, columns)
    image = torch.randn(size.batch, IMAGE_TOKENS, cfg.image_dim, device=device) if cfg.image_dim else None
    return Batch(
        ids=[f"clip{k}" for k in range(size.batch)],
        indices=torch.arange(size.batch), epoch=torch.zeros(size.batch, dtype=torch.int64),
        slot=torch.arange(size.batch) % 2,
        latents={name: torch.randn(one, device=device) for name in streams_of(size)},
        force=torch.randn(one, device=device),
        scalars=torch.rand(size.batch, len(SCALARS), device=device) * 2 - 1,
        reference=torch.randn(size.batch, CHANNELS, *one[3:], device=device),
        text=torch.randn(size.batch, TEXT_TOKENS, cfg.text_dim, device=device),
        image=image,
    )  # fmt: skip


def forward_backward(module: Module, clips: Batch) -> None:
    """Add the gradients of a batch, as the trainer does."""
    mixed = module.cfg.trainer.precision == "bf16-mixed"
    with torch.autocast(clips.force.device.type, torch.bfloat16, enabled=mixed):
        loss = module.losses(clips, module.draw(clips), step=1000).total
    loss.backward()  # type: ignore[no-untyped-call]
