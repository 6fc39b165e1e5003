"""Does a network read its conditions? One at a time is taken from another clip, and loss and scores say what it costs.

Each clip gets a condition of the next clip in which it differs, and keeps all others. A network that does not read the
condition loses nothing: the ratio of its losses is 1, and its samples score as before. Both losses are of the same
noise. Scores compare samples from the same noise with the true latents, both decoded, so that the VAE's error is on
both sides.

Shapes: B clips, T latent frames, S streams of H x W latent rows and columns.
"""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from fracgen import flow
from fracgen.bench.field import Field, Source, load
from fracgen.bench.record import Row
from fracgen.conditioning import SCALARS
from fracgen.data import Batch
from fracgen.denoiser import velocity
from fracgen.evaluation import choose
from fracgen.evaluation.clip import Clip, Pair
from fracgen.evaluation.metric import Metric, reduced
from fracgen.layout import split
from fracgen.losses import flow_matching
from fracgen.model import FracTransformer
from fracgen.training import decoded
from fracgen.vae import FrozenVae

LEVELS = 5
"""Noise levels of the losses, (k + 1/2) / LEVELS, as in a validation."""
SOLVER, STEPS = "unipc", 20
"""Of the samples that are scored."""
TOGETHER = 4
"""Clips in a pass."""
METRICS = ("sac", "dpa")
"""Metrics of samples, whose result of the same name is shown."""
CONDITIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "force": ("force", ()),
    "E": ("scalars", ("E",)),
    "nu": ("scalars", ("nu",)),
    "category": ("scalars", ("low", "high")),
    "thresholds": ("scalars", ("onset", "crit")),
    "caption": ("text", ()),
    "picture": ("reference", ()),
}
"""The field of a batch that holds each condition, and which of SCALARS it is."""


def rows(quick: bool, source: Source, out: Path) -> Iterator[Row]:
    """Ratios of losses by condition and stream, then scores by condition; nothing is written to `out`.

    Raises ValueError for fewer than two clips.
    """
    field = load(source)
    if len(field.x) < 2:
        raise ValueError(f"--clips {source.clips}: a condition is taken from another clip: give 2 or more.")
    network = field.build(torch.float32)
    others = {name: donors(field.batch, name) for name in CONDITIONS}
    own = losses(field, network, field.batch)
    for name, given in others.items():
        yield from compared(field, network, name, given, own)
    decoder, metrics = field.decoder(0), choose.build(choose.choices({name: {} for name in METRICS})).metrics
    usable = {name: m for name, m in metrics.items() if set(m.needs) <= set(field.streams)}
    own_samples = samples(field, network, field.batch, 2 if quick else STEPS)
    yield from scored(field, decoder, usable, own_samples, "its own conditions", range(len(field.x)))
    for name, given in others.items():
        numbers = [k for k, other in enumerate(given) if other is not None]
        if numbers:
            made = samples(field, network, exchanged(field.batch, name, given), 2 if quick else STEPS)
            yield from scored(field, decoder, usable, made, f"{name} of another clip", numbers)


def donors(batch: Batch, name: str) -> list[int | None]:
    """For each clip the next one whose condition differs, None where there is none."""
    values = held(batch, name).flatten(1)
    n = len(values)

    def other(k: int) -> int | None:
        differing = ((k + step) % n for step in range(1, n) if not torch.equal(values[k], values[(k + step) % n]))
        return next(differing, None)

    return [other(k) for k in range(n)]


def held(batch: Batch, name: str) -> Tensor:
    """A condition of the clips, [B, ...]."""
    field, scalars = CONDITIONS[name]
    value: Tensor = getattr(batch, field)
    return value[:, [SCALARS.index(one) for one in scalars]] if scalars else value


def exchanged(batch: Batch, name: str, given: list[int | None]) -> Batch:
    """The batch with one condition of each clip k taken from clip `given[k]`."""
    field, scalars = CONDITIONS[name]
    turn = [k if other is None else other for k, other in enumerate(given)]
    value = getattr(batch, field).clone()
    if scalars:
        columns = [SCALARS.index(one) for one in scalars]
        value[:, columns] = value[turn][:, columns]
    else:
        value = value[turn]
    fields: dict[str, Any] = {field: value}
    if name == "picture" and batch.image is not None:
        fields["image"] = batch.image[turn]
    return batch._replace(**fields)


@torch.no_grad()
def losses(field: Field, network: FracTransformer, batch: Batch) -> Tensor:
    """Mean squared errors of the velocity, [LEVELS, B, S], for the noise of the field."""
    inputs, out = field.conditions(batch), []
    for k in range(LEVELS):
        parts = []
        for some in passes(len(field.x)):
            x, truth = field.x[some], field.truth[some]
            sigma = torch.full((len(some),), (k + 0.5) / LEVELS)
            found = velocity(network, flow.noisy(truth, x, sigma), sigma, inputs.of(some))
            parts.append(flow_matching.per_stream(found, flow.velocity(truth, x), field.streams))
        out.append(torch.cat(parts))
    return torch.stack(out)


def compared(field: Field, network: FracTransformer, name: str, given: list[int | None], own: Tensor) -> Iterator[Row]:
    """Losses with a condition of another clip over those with the clips' `own`, [LEVELS, B, S].

    None where no clip differs in the condition.
    """
    numbers = [k for k, other in enumerate(given) if other is not None]
    if not numbers:
        return
    title = f"loss with {name} of another clip over that with its own"
    mine, theirs = own[:, numbers], losses(field, network, exchanged(field.batch, name, given))[:, numbers]
    yield Row(title, f"all streams, {len(numbers)} clips", float(theirs.mean() / mine.mean()), "1")
    for k, stream in enumerate(field.streams):
        yield Row(title, stream, float(theirs[..., k].mean() / mine[..., k].mean()), "1")
    yield Row(title, f"sigma = {1 - 0.5 / LEVELS:g}", float(theirs[-1].mean() / mine[-1].mean()), "1")


def samples(field: Field, network: FracTransformer, batch: Batch, steps: int) -> Tensor:
    """Joint latents [B, 16, T, S H, W] from the noise of the field."""
    inputs = field.conditions(batch)
    parts = [field.sample(network, SOLVER, steps, inputs=inputs.of(some), x=field.x[some])
             for some in passes(len(field.x))]  # fmt: skip
    return torch.cat(parts)


def passes(clips: int) -> list[Tensor]:
    """The numbers of the clips, [B] each, B at most TOGETHER."""
    return [torch.arange(first, min(first + TOGETHER, clips)) for first in range(0, clips, TOGETHER)]


def scored(
    field: Field, decoder: FrozenVae, metrics: dict[str, Metric], made: Tensor, label: str, numbers: Sequence[int]
) -> Iterator[Row]:
    """Results of the metrics over clips of these numbers, of samples `made`, [B, 16, T, S H, W].

    What is undefined for all clips is left out.
    """

    def clip(latents: Tensor, k: int) -> Clip:
        parts = split(latents[k : k + 1], field.streams)
        return decoded.clip(decoder, field.batch.ids[k], parts, field.about)

    pairs = [Pair(clip(made, k), clip(field.truth, k)) for k in numbers]
    for name, metric in metrics.items():
        value = reduced(metric, [metric.observe(pair) for pair in pairs])[name]
        if math.isfinite(value):
            yield Row(f"{name} of samples", f"{label}, {len(pairs)} clips", value, "1")
