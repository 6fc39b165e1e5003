"""A trained velocity field to sample from: the transformer of a run, clips of its latent cache, the VAE of that cache.

Shapes: B clips, T latent frames, S streams of H x W latent rows and columns.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor

from fracgen import data, encoders, flow, layout, model, vae
from fracgen.bench import cases
from fracgen.config.conditioning import Conditioning
from fracgen.config.model import Encoders
from fracgen.data import Batch
from fracgen.denoiser import Inputs
from fracgen.layout import CHANNELS, PATCH, STREAMS
from fracgen.memory.size import TEXT_TOKENS, Size
from fracgen.model import FracTransformer, trained
from fracgen.model.load import keeps_float32
from fracgen.sampling import generate, trained_run
from fracgen.training import network, noising
from fracgen.vae import FrozenVae


class Source(NamedTuple):
    """What is sampled from, as the command line names it."""

    run: str
    """Folder of a run; empty: random weights, to see whether a measurement runs."""
    vae: str
    """Folder of the VAE of its latents."""
    clips: int
    """The first clips of its cache."""
    split: str = ""
    """Split of the clips; empty: that it was trained on."""


@dataclass(frozen=True)
class Field:
    """What sampling needs, in float32 on the CPU."""

    build: Callable[[torch.dtype], FracTransformer]
    """Makes the network with weights of a type."""
    untrained: Callable[[], FracTransformer]
    """Makes the network as it was before its training."""
    batch: Batch
    """The clips."""
    conditioning: Conditioning
    """How their conditions become inputs."""
    about: Mapping[str, Any]
    """`frames` and `fps` of the clips."""
    empty: Tensor
    """Embedding of the empty caption, [1, 512, D]."""
    x: Tensor
    """The noise to start from, [B, 16, T, S H, W]."""
    truth: Tensor
    """The latents of the clips that the conditions are of, [B, 16, T, S H, W]."""
    streams: tuple[str, ...]
    shift: float
    decoder: Callable[[int], FrozenVae]
    """Makes the VAE with tiles of an edge [px]; 0 = none."""
    label: str

    @property
    def tokens(self) -> int:
        """Tokens of a clip, those of the reference among them."""
        _, _, t, h, w = self.x.shape
        return (t + 1) * (h // PATCH) * (w // PATCH)

    @property
    def inputs(self) -> Inputs:
        """What the network sees of the clips."""
        return self.conditions(self.batch)

    def conditions(self, batch: Batch) -> Inputs:
        """What the network sees of a batch."""
        return _floats(noising.inputs(batch, self.conditioning, 0, train=False))

    def sample(
        self, transformer: FracTransformer, solver: str, steps: int, guidance: float = 1.0, passes: str = "sequential",
        inputs: Inputs | None = None, x: Tensor | None = None,
    ) -> Tensor:  # fmt: skip
        """The joint latents [B, 16, T, S H, W] float32, as `python -m fracgen.sample` makes them; `inputs` and the
        noise `x` replace its own."""
        with transformer.reuse_context():
            return generate.sample(
                transformer, self.x if x is None else x, inputs or self.inputs, flow.levels(steps, self.shift),
                solver=solver, guidance=guidance, empty=self.empty, passes=passes,
            )  # fmt: skip


def load(source: Source) -> Field:
    """The field of a run with conditions of clips that it was trained on; raises ValueError for what does not fit."""
    return _of_run(source) if source.run else _random(source.clips)


def _of_run(source: Source) -> Field:
    run = trained_run.load(source.run)
    run.check_vae(vae.identity_of(cases.small_vae(source.vae)))
    cfg = run.about["config"]
    cache = data.open(cfg["data"]["folder"]).only(run.streams, image=run.model.image_dim > 0)
    numbers = cache.numbers(source.split or cfg["data"]["train_split"], cfg["data"]["objects"])[: source.clips]
    if not numbers:
        raise ValueError(f"--split {source.split}: data.folder={cfg['data']['folder']} has no such clips: choose "
                         "train, test, none or all.")  # fmt: skip
    batch = data.collate([cache[k] for k in numbers])
    words = Encoders(text="words", image="zeros")
    run.check_encoders(words)
    how = Conditioning(**run.about["conditioning"])
    inputs = noising.inputs(batch, how, 0, train=False)

    def build(dtype: torch.dtype) -> FracTransformer:
        return _typed(trained.assemble(source.run, "cpu", dtype, run.model), dtype)

    return Field(
        build, lambda: model.build(run.model, run.streams), batch, how, cache.about,
        encoders.pad(encoders.text(words, run.model.text_dim).encode([""])),
        generate.initial(inputs, 0, batch.ids), layout.join(batch.latents).float(), streams=run.streams,
        shift=run.shift, decoder=lambda tile: vae.load(cases.small_vae(source.vae, tile)),
        label=f"{Path(source.run).name}, {len(numbers)} clip(s) of {cache.about['frames']} frames, "
        f"{cache.about['width']} x {cache.about['height']} px, {len(run.streams)} stream(s)",
    )  # fmt: skip


def _random(clips: int) -> Field:
    """Random weights, random conditions, the smallest sizes."""
    tiny, size = cases.MODELS["tiny"], Size(32, 32, 5, len(STREAMS), clips)
    cfg, batch = cases.config(tiny), cases.batch(tiny, size)
    inputs = noising.inputs(batch, cfg.conditioning, 0, train=False)

    def build(dtype: torch.dtype) -> FracTransformer:
        return _typed(network.build(cfg, STREAMS).eval(), dtype)

    return Field(
        build, lambda: build(torch.float32), batch, cfg.conditioning, {"frames": size.frames, "fps": 50.0},
        torch.zeros(1, TEXT_TOKENS, tiny.text_dim),
        generate.initial(inputs, 0, batch.ids), layout.join(batch.latents), streams=STREAMS, shift=5.0,
        decoder=lambda tile: vae.load(cases.small_vae(tile=tile)),
        label=f"random weights, {size.frames} frames, {size.width} x {size.height} px",
    )  # fmt: skip


def _typed(transformer: FracTransformer, dtype: torch.dtype) -> FracTransformer:
    """The transformer with weights of a type, but for those that stay float32."""
    for name, parameter in transformer.named_parameters():
        if not keeps_float32(transformer, name):
            parameter.data = parameter.data.to(dtype)
    return transformer


def _floats(inputs: Inputs) -> Inputs:
    image = None if inputs.image is None else inputs.image.float()
    return Inputs(inputs.channels.float(), inputs.reference.float(), inputs.text.float(), image)


def decoded(latents: Tensor, decoder: FrozenVae, streams: tuple[str, ...]) -> dict[str, Tensor]:
    """Videos in [0, 1] of joint latents [B, 16, T, S H, W] by stream, [B, 3, F, h, w] each."""
    assert latents.shape[1] == CHANNELS
    return {name: decoder.decode(part) for name, part in layout.split(latents, streams).items()}
