"""Cases of one call of the network and of the losses: noise levels at their ends, wild latents, half precision."""

from collections.abc import Iterator
from pathlib import Path

import torch
from torch import Tensor, nn

from fracgen import draws
from fracgen.data import Batch
from fracgen.denoiser import velocity
from fracgen.layout import CHANNELS, STREAMS
from fracgen.losses import constitutive
from fracgen.model.load import keeps_float32
from fracgen.stress.case import Case
from fracgen.stress.place import Place, config
from fracgen.training import identity, network, noising
from fracgen.training.module import Module

WILD = 1e4
"""Latents so many standard deviations off."""


def cases() -> list[Case]:
    """All of them."""
    return [
        Case("sigma = 0", lambda p, f: losses(p, f, 0.0)),
        Case("sigma = 1", lambda p, f: losses(p, f, 1.0)),
        Case("sigma = 0, bfloat16", lambda p, f: losses(p, f, 0.0, mixed=True)),
        Case("sigma = 1, bfloat16", lambda p, f: losses(p, f, 1.0, mixed=True)),
        Case("w(t) = ratio at sigma = 0 and 1", weights),
        Case("latents of 1e4, bfloat16", lambda p, f: losses(p, f, 0.5, mixed=True, factor=WILD)),
        Case("latents of 1e4, all weights bfloat16", overflow),
        Case("all maps the same constant", lambda p, f: losses(p, f, 0.5, constant=True)),
        Case("all maps and noise zero", lambda p, f: losses(p, f, 0.0, constant=True, factor=0.0)),
        Case("batch of one", lambda p, f: losses(p, f, 0.5, clips=(0,))),
        Case("raw Lame parameters at nu = 0.5", incompressible, refusal=r"loss\.lame=raw needs nu < 0\.5"),
    ]


def losses(
    place: Place, folder: Path, sigma: float, *, mixed: bool = False, factor: float = 1.0, constant: bool = False,
    clips: tuple[int, ...] = (0, 1),
) -> Iterator[Tensor]:  # fmt: skip
    """All losses and all gradients of a batch at a noise level, in the constitutive stage."""
    batch, module = changed(place.batch(*clips), factor, constant), _module(place, folder)
    given = noising.inputs(batch, module.cfg.conditioning, 0, train=True)
    noise = 0 * noising.noise(batch, 0) if factor == 0 else noising.noise(batch, 0)
    noised = noising.noised(batch, noise, torch.full((len(clips),), sigma), given)
    with torch.autocast("cpu", torch.bfloat16, enabled=mixed):
        found = module.losses(batch, noised, step=1000)
    found.total.backward()  # type: ignore[no-untyped-call]
    yield from (found.total.detach(), found.streams)
    yield from (p.grad for _, p in module.trained() if p.grad is not None)
    nn.utils.clip_grad_norm_([p for _, p in module.trained()], 1.0)
    yield from (p.grad for _, p in module.trained() if p.grad is not None)


def changed(batch: Batch, factor: float, constant: bool) -> Batch:
    """A batch with latents that are multiplied, or the same everywhere."""
    latents = {name: factor * (torch.ones_like(x) if constant else x).float() for name, x in batch.latents.items()}
    return batch._replace(latents=latents, force=batch.force.float() * factor, reference=batch.reference.float())


def _module(place: Place, folder: Path) -> Module:
    """The constitutive stage with random weights."""
    cfg = config(folder, place.latents)
    return Module(cfg, identity.recipe_of(cfg, 1), network.build(cfg, STREAMS), total=1000)


def weights(place: Place, folder: Path) -> Iterator[Tensor]:
    """All weights of the constitutive loss at both ends."""
    yield from (constitutive.noise_weight(torch.tensor([0.0, 1.0]), kind) for kind in ("clean", "ratio", "none"))


def overflow(place: Place, folder: Path) -> Iterator[Tensor]:
    """A velocity when weights and inputs are bfloat16, but for what stays float32, at a wild latent."""
    module, batch = _module(place, folder), place.batch(0)
    transformer = module.transformer.eval()
    for name, parameter in transformer.named_parameters():
        if not keeps_float32(transformer, name):
            parameter.data = parameter.data.bfloat16()
    given = noising.inputs(batch, module.cfg.conditioning, 0, train=False)
    given = given._replace(text=given.text.bfloat16(), reference=given.reference.bfloat16())
    x = WILD * draws.normal((1, CHANNELS, *given.channels.shape[2:]), 0, "wild")
    with torch.no_grad():
        yield velocity(transformer, x.bfloat16(), torch.ones(1), given).float()


def incompressible(place: Place, folder: Path) -> Iterator[Tensor]:
    """The Lame parameters of a material that keeps its volume."""
    yield from constitutive.lame(torch.tensor([[0.0, 1.0, 1.0, -1.0, 0.0, 0.0]]), "raw")
