"""Time of a sampled clip against its error: solver, steps, precision, guidance, attention back-end, tiles of the VAE.

Errors are measured from a run of 200 steps in float32 from the same noise, with the same guidance: of latents the root
mean square of the difference over that of the reference; of decoded streams the root mean square of the difference of
pixels in [0, 1], of which the worst stream counts. Times are processor time for all clips together, sampling and
decoding; wall time is stored beside it.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from fracgen.bench.field import Field, Source, decoded, load
from fracgen.bench.record import Row
from fracgen.memory import attention

STEPS = (2, 3, 5, 10, 20, 30, 50, 100, 200)
FEW = (5, 10, 30)
"""Steps at which precision, guidance and back-ends are compared."""
GUIDANCE = 4.0
MOST = 200
"""Steps of the reference."""
TILE = 32
"""Edge of tiles [px], the smallest."""
PRESETS = ("preview", "default", "reference")
COLOURS = {"euler": "#31688e", "unipc": "#b5323c"}
MARKS = {"float32": "o", "bfloat16": "s"}


@dataclass(frozen=True)
class Setting:
    """How clips are sampled and decoded."""

    solver: str
    steps: int
    dtype: str = "float32"
    guidance: float = 1.0
    passes: str = "sequential"
    backend: str = "native"
    tile: int = 0

    def __str__(self) -> str:
        parts = [self.solver, f"{self.steps} steps"]
        parts += [self.dtype] if self.dtype != "float32" else []
        parts += [f"guidance {self.guidance:g}"] if self.guidance != 1 else []
        parts += [self.passes] if self.passes != "sequential" else []
        parts += [self.backend] if self.backend != "native" else []
        parts += [f"tiles of {self.tile} px"] if self.tile else []
        return ", ".join(parts)


@dataclass(frozen=True)
class Point:
    """A setting, what it took, and what came of it."""

    setting: Setting
    sample: float
    """Processor time of sampling [s]."""
    decode: float
    """Processor time of decoding all streams [s]."""
    wall: float
    latents: Tensor = field(repr=False)
    videos: dict[str, Tensor] = field(repr=False)
    error: float = 0.0
    """Of latents."""
    errors: dict[str, float] = field(default_factory=dict)
    """Of decoded streams."""

    @property
    def seconds(self) -> float:
        """Processor time [s]."""
        return self.sample + self.decode

    @property
    def worst(self) -> float:
        """Error of the worst decoded stream."""
        return max(self.errors.values(), default=0.0)


def settings(quick: bool) -> list[Setting]:
    """All that is tried; the reference of each guidance is among them."""
    if quick:
        return [Setting(s, n, guidance=g) for g in (1.0, GUIDANCE) for s, n in (("unipc", 4), ("euler", 2))]
    out = [Setting(solver, n) for solver in COLOURS for n in STEPS]
    out += [Setting("unipc", n, dtype="bfloat16") for n in (*FEW, MOST)] + [Setting("euler", 30, dtype="bfloat16")]
    out += [Setting("unipc", n, guidance=GUIDANCE) for n in (*FEW, MOST)]
    out += [Setting("unipc", 10, guidance=GUIDANCE, passes="batched")]
    others = [name for name in attention.available("cpu", training=False) if name != "native"]
    out += [Setting("unipc", 10, backend=name) for name in others]
    return [*out, Setting("unipc", 10, tile=TILE)]


def measure(source: Field, setting: Setting) -> Point:
    """Sample and decode once."""
    transformer = source.build(getattr(torch, setting.dtype))
    attention.set_backend(transformer, setting.backend, "cpu", training=False)
    decoder = source.decoder(setting.tile)
    wall, begin = time.perf_counter(), time.process_time()
    latents = source.sample(transformer, setting.solver, setting.steps, setting.guidance, setting.passes)
    between = time.process_time()
    videos = decoded(latents, decoder, source.streams)
    end = time.process_time()
    attention.set_backend(transformer, "native", "cpu", training=False)  # diffusers keeps it for all networks
    return Point(setting, between - begin, end - between, time.perf_counter() - wall, latents, videos)


def points(source: Field, tried: list[Setting]) -> Iterator[Point]:
    """All settings with their errors; the references, which have the most steps of the solver `unipc`, come first."""
    references: dict[float, Point] = {}
    for setting in sorted(tried, key=lambda s: (s.guidance, -s.steps, s.dtype != "float32", s.solver != "unipc")):
        found = measure(source, setting)
        reference = references.setdefault(setting.guidance, found)
        yield _compared(found, reference)


def _compared(found: Point, reference: Point) -> Point:
    """The point with its errors."""
    error = _rms(found.latents - reference.latents) / _rms(reference.latents)
    errors = {name: _rms(video - reference.videos[name]) for name, video in found.videos.items()}
    return Point(found.setting, found.sample, found.decode, found.wall, found.latents, found.videos, error, errors)


def _rms(x: Tensor) -> float:
    return float(x.square().mean().sqrt())


def front(found: list[Point]) -> list[Point]:
    """Points that no other one beats in both time and error of latents, fastest first."""
    best, out = float("inf"), []
    for p in sorted(found, key=lambda p: (p.seconds, p.error)):
        if p.error < best:
            best = p.error
            out.append(p)
    return out


def presets() -> dict[str, Setting]:
    """The settings of conf/sampler; on a CPU dtype=auto is float32."""
    from fracgen.sample import SAMPLE

    out = {}
    for name in PRESETS:
        s = SAMPLE.compose("run=none", f"sampler={name}").sampler
        out[name] = Setting(s.solver, s.steps, "float32" if s.dtype == "auto" else s.dtype, s.guidance)
    return out


def rows(quick: bool, source: Source, out: Path) -> Iterator[Row]:
    """Times and errors of all settings; writes gen_pareto.png to `out`."""
    given, named, found = load(source), presets(), []
    tried = list(dict.fromkeys([*settings(quick), *([] if quick else named.values())]))
    measure(given, Setting("euler", 1))  # what is slow once only
    for p in points(given, tried):
        found.append(p)
        yield Row("processor time", str(p.setting), p.seconds, "s")
        yield Row("of it decoding", str(p.setting), p.decode, "s")
        yield Row("wall time", str(p.setting), p.wall, "s")
        yield Row("error of latents", str(p.setting), 100 * p.error, "%")
        for name, error in p.errors.items():
            yield Row(f"error of {name}, decoded", str(p.setting), 100 * error, "%")
    plain = [p for p in found if p.setting.guidance == 1]
    for p in front(plain):
        yield Row("on the front", str(p.setting), p.seconds, "s")
    out.mkdir(parents=True, exist_ok=True)
    plot(found, named, given.label, out / f"gen_pareto{'_quick' if quick else ''}.png")


def plot(found: list[Point], named: dict[str, Setting], label: str, path: Path) -> None:
    """Error of latents, and of the worst decoded stream, against processor time. Numbers are steps."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure: Any = Figure(figsize=(13, 5), layout="constrained")
    FigureCanvasAgg(figure)
    shown = [p for p in found if p.error > 0 and p.setting.guidance == 1]
    shown_errors: dict[str, Callable[[Point], float]] = {
        "latents": lambda p: p.error, "worst decoded stream": lambda p: p.worst,
    }  # fmt: skip
    for k, (title, value) in enumerate(shown_errors.items()):
        axes: Any = figure.add_subplot(1, 2, k + 1)
        line = front(shown)
        axes.plot([p.seconds for p in line], [100 * value(p) for p in line], color="#b0b0b0", zorder=0)
        for p in shown:
            s = p.setting
            other = s.backend != "native" or s.tile
            axes.plot(p.seconds, 100 * value(p), linestyle="", marker="x" if other else MARKS[s.dtype],
                      color=COLOURS[s.solver], alpha=0.8)  # fmt: skip
            names = [name for name, preset in named.items() if preset == s]
            text = f"{s.steps}" + (f" {names[0]}" if names else "")
            axes.annotate(text, (p.seconds, 100 * value(p)), xytext=(4, 4), textcoords="offset points", fontsize=8,
                          weight="bold" if names else "normal")  # fmt: skip
        axes.set(title=title, xscale="log", yscale="log", xlabel="processor time of sampling and decoding [s]",
                 ylabel="error against 200 steps [%]")  # fmt: skip
        axes.grid(alpha=0.2)
    for solver, colour in COLOURS.items():
        axes.plot([], [], "o", color=colour, label=solver)
    axes.plot([], [], "s", color="#808080", label="bfloat16")
    axes.plot([], [], "x", color="#808080", label="another back-end, or tiles")
    axes.legend(fontsize=8)
    figure.suptitle(label, fontsize=9)
    figure.savefig(path, dpi=100, metadata={"Software": None})
