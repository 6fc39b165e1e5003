"""A run of `+debug=overfit`: does the network learn one batch by heart, and do its samples look like the clips?

`first loss` is that of the untrained network, `last loss` that of the trained one, for the same clips with the same
noise, at five noise levels. Sampled latents are compared with those of the clips, decoded streams with
the decoded latents of the clips, so that the VAE's own error is left out.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from fracgen import flow
from fracgen.bench.field import Field, Source, decoded, load
from fracgen.bench.record import Row
from fracgen.denoiser import velocity
from fracgen.layout import split
from fracgen.losses import flow_matching
from fracgen.model import FracTransformer
from fracsim.records import Array

SOLVER, STEPS = "unipc", 30
LEARNT = 2.0
"""Largest last loss over the first [%]."""
LEVELS = 5
"""Noise levels of the losses, (k + 1/2) / LEVELS, as in a validation."""
COLUMNS = 5
"""Frames of the picture."""


def rows(quick: bool, source: Source, out: Path) -> Iterator[Row]:
    """Losses, errors of samples by stream, and whether they follow swapped conditions; writes overfit.png to `out`."""
    field = load(source)
    yield from learnt(field)
    network = field.build(torch.float32)
    latents = field.sample(network, SOLVER, 2 if quick else STEPS)
    for name, (mine, theirs) in _by_stream(field, latents, field.truth).items():
        yield Row("error of sampled latents", name, 100 * _distance(mine, theirs), "% of their deviation")
    decoder = field.decoder(0)
    made, true = (decoded(x, decoder, field.streams) for x in (latents, field.truth))
    for name in field.streams:
        yield Row("PSNR of the sampled clips", f"{name}, to the decoded latents of the clips", psnr(made[name],
                  true[name]), "dB")  # fmt: skip
    if len(latents) == 2:
        yield from swapped(field, 2 if quick else STEPS)
    out.mkdir(parents=True, exist_ok=True)
    picture(made, true, out / f"overfit{'_quick' if quick else ''}.png")


def learnt(field: Field) -> Iterator[Row]:
    """Losses of the untrained and the trained network, by stream and by noise level, and their ratio."""
    first, last = (losses(field, network) for network in (field.untrained(), field.build(torch.float32)))
    yield Row("first loss", "all streams", float(first.mean()), "1")
    yield Row("last loss", "all streams", float(last.mean()), "1")
    yield Row("last over first loss", "all streams", 100 * float(last.mean() / first.mean()), "%", LEARNT)
    for k, name in enumerate(field.streams):
        yield Row("last over first loss", name, 100 * float(last[:, k].mean() / first[:, k].mean()), "%")
    for k in range(LEVELS):
        ratio = 100 * float(last[k].mean() / first[k].mean())
        yield Row("last over first loss", f"sigma = {(k + 0.5) / LEVELS:g}", ratio, "%")


@torch.no_grad()
def losses(field: Field, network: FracTransformer) -> Tensor:
    """Mean squared errors of the velocity over clips, with noise that the training has not seen, [LEVELS, S]."""
    out = []
    for k in range(LEVELS):
        sigma = torch.full((len(field.x),), (k + 0.5) / LEVELS)
        found = velocity(network, flow.noisy(field.truth, field.x, sigma), sigma, field.inputs)
        target = flow.velocity(field.truth, field.x)
        out.append(flow_matching.per_stream(found, target, field.streams).mean(dim=0))
    return torch.stack(out)


def swapped(field: Field, steps: int) -> Iterator[Row]:
    """Two clips whose force, material and captions change places: each sample must become the other clip."""
    turn = torch.tensor([1, 0])
    own = field.inputs
    given = own._replace(channels=own.channels[turn], text=own.text[turn])
    network = field.build(torch.float32)
    for label, inputs in (("force, material, caption", given), ("force and material", given._replace(text=own.text))):
        made = field.sample(network, SOLVER, steps, inputs=inputs)
        for what, other in (("the other clip", field.truth[turn]), ("its own clip", field.truth)):
            yield Row(f"{label} swapped", f"distance of latents to {what}", 100 * _distance(made, other),
                      "% of their deviation")  # fmt: skip


def _by_stream(field: Field, first: Tensor, second: Tensor) -> dict[str, tuple[Tensor, Tensor]]:
    parts = split(first, field.streams), split(second, field.streams)
    return {name: (parts[0][name], parts[1][name]) for name in field.streams}


def _distance(x: Tensor, truth: Tensor) -> float:
    """Root mean square of the difference over the standard deviation of the truth, any shape."""
    return float((x - truth).square().mean().sqrt() / truth.std())


def psnr(x: Tensor, truth: Tensor) -> float:
    """Peak signal to noise ratio [dB] of videos in [0, 1], any shape; at most 100."""
    return float(-10 * (x - truth).square().mean().clamp(min=1e-10).log10())


def picture(made: dict[str, Tensor], true: dict[str, Tensor], path: Path) -> None:
    """Streams one below the other, evenly spread frames from left to right, the true clip beside the sampled one."""
    bands = []
    for clip in range(len(next(iter(made.values())))):
        for name in made:
            bands.append(np.concatenate([_strip(true[name][clip]), _gap(true[name]), _strip(made[name][clip])], axis=1))
    Image.fromarray(np.concatenate(bands)).save(path, optimize=True)


def _strip(video: Tensor) -> Array:
    """Frames of a video [3, F, h, w] side by side, (h, n w, 3) uint8."""
    frames = torch.linspace(0, video.shape[1] - 1, min(COLUMNS, video.shape[1])).round().long()
    pixels = video[:, frames].permute(2, 1, 3, 0).flatten(1, 2)
    return np.asarray((255 * pixels).round().byte())


def _gap(video: Tensor) -> Array:
    return np.full((video.shape[-2], 8, 3), 128, np.uint8)
