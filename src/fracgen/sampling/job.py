"""One sampling command: from its configuration to samples on disk."""

import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

import torch

from fracgen import flow
from fracgen.config.sample import SampleConfig
from fracgen.layout import RGB
from fracgen.sampling import generate, networks, records, trained_run
from fracgen.sampling.networks import Networks
from fracgen.sampling.records import Made
from fracgen.sampling.request import Request, requests
from fracsim.entry import signs_every
from fracsim.sample import find
from fracsim.sample.folder import clear, root

Tick = Callable[[], None]


def run(cfg: SampleConfig) -> list[Path]:
    """Sample all that is asked for and is not there, and return the folders of all; raises ValueError, OSError."""
    source = trained_run.load(cfg.run, cfg.base)
    maps = source.maps(cfg.maps)
    asked = requests(cfg, source, maps)
    source.check_encoders(cfg.encoders)
    device = _device(cfg.device)
    made = Made(cfg, source, maps, _sampler(cfg, source, device))
    clear(root(made.output))
    names = [records.identity(request, made) for request in asked]
    there = {} if cfg.output.overwrite else {name: path for name in names if (path := find(made.output, name))}
    todo = {name: request for name, request in zip(names, asked, strict=True) if name not in there}
    if todo:
        there |= dict(zip(todo, _sample(list(todo.values()), made, device), strict=True))
    return [there[name] for name in names]


def _sample(todo: Sequence[Request], made: Made, device: torch.device) -> list[Path]:
    """Sample requests, in batches, and return their folders."""
    cfg = made.cfg
    there = networks.load(todo, cfg, made.run, str(made.sampler["dtype"]), device)
    batches = [todo[k : k + cfg.batch] for k in range(0, len(todo), cfg.batch)]
    calls = len(batches) * cfg.sampler.steps + len(todo) * (1 + len(made.maps))
    with _progress(calls, f"sampling {len(todo)} clip(s)") as tick:
        return [folder for batch in batches for folder in _batch(batch, there, made, device, tick)]


def _batch(asked: Sequence[Request], there: Networks, made: Made, device: torch.device, tick: Tick) -> Iterator[Path]:
    """Sample a batch, write its samples and give their folders; raises ValueError when a latent is not finite."""
    cfg, begin = made.cfg, time.perf_counter()
    given, first = networks.inputs(asked, there, made.run, cfg.ranges)
    with there.transformer.reuse_context():  # exact, since captions and pictures stay the same
        latents = generate.sample(
            there.transformer,
            generate.initial(given, cfg.seed, [request.key for request in asked]).to(device),
            given,
            flow.levels(cfg.sampler.steps, float(made.sampler["shift"])),
            solver=cfg.sampler.solver,
            guidance=cfg.sampler.guidance,
            empty=there.captions(""),
            passes=cfg.sampler.passes,
            first=first if cfg.sampler.overwrite_first_latent else None,
            advance=tick,
        )
    if not torch.isfinite(latents).all():
        raise ValueError(f"sampler.dtype={made.sampler['dtype']}: the network gives numbers that are not finite; set "
                         "sampler.dtype=float32, or check the weights of the run.")  # fmt: skip
    share = (time.perf_counter() - begin) / len(asked)
    for k, request in enumerate(asked):
        begin, videos = time.perf_counter(), {}
        for name, video in networks.decode(latents[k : k + 1], (RGB, *made.maps), there.vae, made.run):
            videos[name] = video
            tick()
        seconds = {"sample": share, "decode": time.perf_counter() - begin}
        yield records.write(request, made, videos.pop(RGB), videos, seconds)


def _sampler(cfg: SampleConfig, source: trained_run.TrainedRun, device: torch.device) -> dict[str, str | float | bool]:
    """The settings that shape a sample, resolved; warns of a shift that is not that of the training."""
    chosen = asdict(cfg.sampler)
    del chosen["passes"]
    chosen["shift"] = chosen["shift"] or source.shift
    if chosen["dtype"] == "auto":
        chosen["dtype"] = "bfloat16" if device.type == "cuda" else "float32"
    if chosen["shift"] != source.shift:
        warnings.warn(f"sampler.shift={chosen['shift']:g} is not that of the training, {source.shift:g}: the network "
                      "saw other noise levels more often; sampler.shift=0 takes that one.", stacklevel=2)  # fmt: skip
    return chosen


def _device(name: str) -> torch.device:
    """The device of a name; raises ValueError for one that is not there."""
    there = {"cpu": True, "cuda": torch.cuda.is_available(), "mps": torch.backends.mps.is_available()}
    if name == "auto":
        return torch.device("cuda" if there["cuda"] else "cpu")
    if not there[name]:
        raise ValueError(f"device={name} is not there: set device=auto.")
    return torch.device(name)


@contextmanager
def _progress(total: int, heading: str) -> Iterator[Tick]:
    """A bar of calls of networks with an estimate of the time left; without a terminal, a line now and then."""
    if not sys.stderr.isatty():
        yield _lines(total)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(16), MofNCompleteColumn(), TimeRemainingColumn(),
               TextColumn("left"))  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(heading, total=total)
        yield lambda: bar.advance(task)


def _lines(total: int) -> Tick:
    """Counts calls of networks, and says on stderr how many are done."""
    done, told, every = 0, time.monotonic(), signs_every()

    def tick() -> None:
        nonlocal done, told
        done += 1
        if time.monotonic() - told >= every:
            told = time.monotonic()
            print(f"call {done} of {total}", file=sys.stderr, flush=True)

    return tick
