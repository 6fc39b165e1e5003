"""What is saved by each computation that is left out where it is not needed.

Measured with the tiny sizes on this machine, both variants in turn; counted, in operations, with the released sizes on
tensors without memory. A ratio is what it would take over what it takes.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from statistics import median as middle
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils.flop_counter import FlopCounterMode

from fracgen import flow, layout, vae
from fracgen.bench import cases
from fracgen.bench.record import Row
from fracgen.config.model import Model
from fracgen.denoiser import Inputs
from fracgen.encoders import clip, umt5
from fracgen.layout import RGB, STREAMS
from fracgen.memory.flops import flops
from fracgen.memory.size import TEXT_TOKENS, Size
from fracgen.model import FracTransformer, empty
from fracgen.sampling import generate
from fracgen.training import network, noising

STEPS = 4
"""Of a sampling that is timed."""
FRAMES, WIDTH = 81, 512
"""Of the clips whose operations are counted."""
CAPTION = 32
"""Tokens of a caption of fracsim, about."""
PETA = 1e15


def rows(quick: bool = False) -> Iterator[Row]:
    """All figures; `quick` takes the smallest sizes."""
    size, repeats = (Size(32, 32, 5, 5), 1) if quick else (cases.SIZES["tiny"], 5)
    yield from maps(size, repeats)
    yield from sampling(size, repeats)
    yield from counted(Model(layers=1) if quick else Model(), 32 if quick else WIDTH, 5 if quick else FRAMES)
    yield from encoders(quick)


def pair(what: str, label: str, always: Callable[[], object], skipped: Callable[[], object], repeats: int) -> Row:
    """Processor time of `always` over that of `skipped`, which run in turn after a first run of each."""
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats + 1):
        for work, found in zip((always, skipped), times, strict=True):
            begin = time.process_time()
            work()
            found.append(time.process_time() - begin)
    first, second = (middle(found[1:]) for found in times)
    return Row(f"{what}, measured", label, first / max(second, 1e-9), "times")


def maps(size: Size, repeats: int) -> Iterator[Row]:
    """A stage or a user that asks for colour only: no map is encoded, predicted or decoded."""
    network_ = vae.load(cases.small_vae())
    video = torch.rand(1, 3, size.frames, size.height, size.width)
    latent = network_.encode(video)
    shape = f"{size.frames} frames, {size.width} x {size.height} px, vae=tiny"
    yield pair("no map decoded that is not asked for", f"5 streams or colour; {shape}",
               lambda: [network_.decode(latent) for _ in STREAMS], lambda: network_.decode(latent),
               repeats)  # fmt: skip
    yield pair("no map encoded that is not asked for", f"5 streams and force, or colour and force; {shape}",
               lambda: [network_.encode(video) for _ in range(6)],
               lambda: [network_.encode(video) for _ in range(2)], repeats)  # fmt: skip
    yield pair("no map predicted in stage 1", f"a training step, {size.frames} frames, {size.width} x {size.height} px,"
               " model=tiny", _step(size, len(STREAMS)), _step(size, 1), repeats)  # fmt: skip


def _step(size: Size, streams: int) -> Callable[[], None]:
    """A forward and backward pass with so many streams."""
    one, cfg = replace(size, streams=streams), cases.config(cases.MODELS["tiny"])
    module, batch = cases.module(cfg, one), cases.batch(cfg.model, one)
    return lambda: cases.forward_backward(module, batch)


def sampling(size: Size, repeats: int) -> Iterator[Row]:
    """No second pass at guidance 1; keys and values of caption and picture kept over the steps."""
    cfg = cases.config(cases.MODELS["tiny"])
    tiny = network.build(cfg, STREAMS).eval()
    inputs = noising.inputs(cases.batch(cfg.model, size), cfg.conditioning, 0, train=False)
    empty_ = torch.zeros(1, TEXT_TOKENS, cfg.model.text_dim)
    label = f"{STEPS} steps, {size.tokens} tokens, model=tiny"
    yield pair("no second pass at guidance 1", label, lambda: _sample(tiny, inputs, empty_, 1.0001),
               lambda: _sample(tiny, inputs, empty_, 1.0), repeats)  # fmt: skip
    yield pair("keys of the caption kept over the steps", label, lambda: _sample(tiny, inputs, empty_, 1.0, False),
               lambda: _sample(tiny, inputs, empty_, 1.0), repeats)  # fmt: skip


def _sample(transformer: FracTransformer, inputs: Inputs, without: Tensor, guidance: float, kept: bool = True) -> None:
    with transformer.reuse_context() if kept else nullcontext():
        generate.sample(transformer, generate.initial(inputs, 0, [0]), inputs, flow.levels(STEPS, 5.0),
                        guidance=guidance, empty=without)  # fmt: skip


# Counted


def counted(model: Model, width: int, frames: int) -> Iterator[Row]:
    """The same for the released sizes, by operations."""
    for count in (1, len(STREAMS)):
        size = Size(width, width, frames, count)
        label = f"a sampling step, {count} stream(s), {frames} frames, {width} x {width} px, model=fun_1_3b"
        always, kept = forward(model, size, False), forward(model, size, True)
        yield Row("keys of caption and picture kept over the steps, counted", label, always / kept, "times")
    one, five = (flops(model, Size(width, width, frames, n), "full").total for n in (1, len(STREAMS)))
    yield Row("no map predicted in stage 1, counted", f"a training step, {frames} frames, {width} x {width} px",
              five / one, "times")  # fmt: skip


def forward(model: Model, size: Size, kept: bool) -> int:
    """Operations of a forward pass, of the second one where what does not change is `kept`."""
    transformer = empty(model, STREAMS[: size.streams]).eval()
    frames, rows_, columns = size.latent
    with torch.device("meta"), torch.no_grad(), transformer.reuse_context() if kept else nullcontext():
        x = torch.empty(1, 48, frames, rows_, columns), torch.empty(1)
        context = torch.empty(1, TEXT_TOKENS, model.text_dim), torch.empty(1, 257, model.image_dim)
        reference = torch.empty(1, layout.CHANNELS, rows_, columns)
        if kept:
            transformer(*x, *context, reference)
        with FlopCounterMode(display=False) as counter:
            transformer(*x, *context, reference)
    return int(counter.get_total_flops())


def encoders(quick: bool) -> Iterator[Row]:
    """What a training step would take besides, if nothing were cached: caption, picture, and six videos."""
    model, size = Model(), Size(WIDTH, WIDTH, FRAMES, 1)
    step, label = flops(model, size, "full").total, f"a step of stage 1, {FRAMES} frames, {WIDTH} x {WIDTH} px"
    for name, extra in (("caption (UMT5-xxl)", text_flops()), ("picture (CLIP ViT-H/14)", image_flops())):
        what = f"no pass of the encoder of the {name} when cached, counted"
        yield Row(what, "operations of a clip", extra / PETA, "PFLOP")
        yield Row(what, label, (step + extra) / step, "times")
    if not quick:
        video = video_flops()
        yield Row("no pass of the VAE when cached, counted", "operations of a video", video / PETA, "PFLOP")
        yield Row("no pass of the VAE when cached, counted", f"{label}, {RGB} and force", (step + 2 * video) / step,
                  "times")  # fmt: skip


def _count(network_: nn.Module, call: Callable[[], object]) -> int:
    """Operations of a call of a network on the meta device."""
    network_.eval()
    with torch.device("meta"), torch.no_grad(), FlopCounterMode(display=False) as counter:
        call()
    return int(counter.get_total_flops())


def text_flops() -> int:
    """Operations of UMT5-xxl for one caption."""
    net = umt5.network(umt5.SIZES)
    return _count(net, lambda: net(torch.zeros(1, CAPTION, dtype=torch.long)))


def image_flops() -> int:
    """Operations of CLIP ViT-H/14 for one picture."""
    net = clip.network(clip.SIZES)
    return _count(net, lambda: net(torch.zeros(1, 3, 224, 224)))


def video_flops() -> int:
    """Operations of the released VAE for one video."""
    from diffusers import AutoencoderKLWan

    untyped: Any = AutoencoderKLWan
    with torch.device("meta"):
        net = untyped()
    return _count(net, lambda: net.encode(torch.zeros(1, 3, FRAMES, WIDTH, WIDTH)))
