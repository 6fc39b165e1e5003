"""strip.mp4: colour and maps side by side, for people.

The colours want the largest value of the clip, which is known at the end, so small frames wait in a scratch file.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fracsim.records import Array
from fracsim.sample.quantise import dequantise, quantise
from fracsim.sample.video import Encoder

WIDEST = 320
"""Panels are reduced by a whole factor until they are no wider [px]."""
HEADER, GAP = 24, 4
"""Height of the labels and width of the space between panels [px]."""
GREY = "#606060"
COLOURS = ("viridis", "inferno", "plasma", "cividis")
"""Matplotlib colour maps of the scalar maps, in turn."""
FAINT = np.float32(0.05)
"""Coverage below which a pixel is too faint to be measured."""


def reduction(width: int) -> int:
    """Whole factor by which pictures of this width shrink."""
    return -(-width // WIDEST)


@dataclass(frozen=True)
class Panel:
    """A map in the strip."""

    name: str
    label: str
    unit: str
    channels: int
    scale: float | None
    """Value shown in full colour; None = nearly the largest of the clip."""

    @classmethod
    def of(cls, name: str, module: ModuleType) -> "Panel":
        """The panel of a map module."""
        return cls(name, module.LABEL, module.UNIT, module.CHANNELS, module.SCALE)


class Strip:
    """Collects frames and encodes them; width and height [px] are those of the sample."""

    def __init__(self, folder: Path, width: int, height: int, rgb: bool, panels: list[Panel], fps: float) -> None:
        self._factor = reduction(width)
        self._shape = -(-height // self._factor), -(-width // self._factor)
        self._rgb, self._panels, self._fps = rgb, panels, fps
        self._peaks = {panel.name: 0.0 for panel in panels}
        self._ranges: list[list[tuple[float, float]]] = []
        self._scratch_path = folder / "strip.scratch"
        self._scratch = self._scratch_path.open("wb+")

    def add(self, rgb: Array | None, alpha: Array, maps: Mapping[str, Array]) -> None:
        """Take a frame: rgb uint8 [H, W, 3], alpha [H, W], and the planes of the maps, [C, H, W]."""
        coverage, ranges = self._small(np.asarray(alpha, np.float32)), []
        if rgb is not None:
            self._scratch.write(self._small(rgb).tobytes())
        self._scratch.write((np.clip(coverage, 0, 1) * 255 + 0.5).astype(np.uint8).tobytes())
        covered = coverage > FAINT
        for panel in self._panels:
            # The quantity itself, not how much of it shows: no dark rim where coverage fades.
            planes = np.stack([self._small(plane) for plane in maps[panel.name]]) / np.maximum(coverage, FAINT)
            magnitude = np.sqrt((planes[:, covered] ** 2).sum(axis=0))
            if magnitude.size:  # a single wild particle shall not make the clip dark
                self._peaks[panel.name] = max(self._peaks[panel.name], float(np.percentile(magnitude, 99.5)))
            codes, span = quantise(planes)
            self._scratch.write(codes.tobytes())
            ranges.append(span)
        self._ranges.append(ranges)

    def _small(self, picture: Array) -> Array:
        """`picture`, uint8 [H, W, 3] or float32 [H, W], averaged over blocks."""
        return np.asarray(Image.fromarray(picture).reduce(self._factor))

    def encode(self, path: Path) -> None:
        """Write the strip and drop the scratch file; raises OSError when the disk is full."""
        h, w = self._shape
        tiles = self._rgb + len(self._panels)
        width, height = tiles * (w + GAP) + GAP, HEADER + h + GAP
        scales = {p.name: p.scale or self._peaks[p.name] or 1.0 for p in self._panels}
        header = self._header(width + width % 2, height + height % 2, scales)
        self._scratch.seek(0)
        with Encoder(path, width + width % 2, height + height % 2, "strip") as encoder:
            for index, ranges in enumerate(self._ranges):
                picture = _stamped(header, f"t = {index / self._fps:.3f} s" if self._rgb else "")
                for k, tile in enumerate(self._tiles(ranges, scales)):
                    left = GAP + k * (w + GAP)
                    picture[HEADER : HEADER + h, left : left + w] = tile
                encoder.write(picture)
        self.close()

    def close(self) -> None:
        """Drop the scratch file."""
        self._scratch.close()
        self._scratch_path.unlink(missing_ok=True)

    def _header(self, width: int, height: int, scales: dict[str, float]) -> Image.Image:
        """A white picture with lines between the panels, their names, and what their full colours mean."""
        picture = Image.new("RGB", (width, height), "white")
        draw, step = ImageDraw.Draw(picture), self._shape[1] + GAP
        texts = [("rgb", "")] if self._rgb else []
        texts += [(panel.label, f"0 to {amount(scales[panel.name], panel.unit)}") for panel in self._panels]
        for k, (label, full) in enumerate(texts):
            draw.text((GAP + k * step + 4, 4), label, fill="black", font=_font())
            draw.text(((k + 1) * step - 4, 4), full, fill=GREY, font=_font(), anchor="ra")
            if k:
                draw.line([k * step + GAP // 2, 0, k * step + GAP // 2, height], fill="#d8d8d8")
        return picture

    def _tiles(self, ranges: list[tuple[float, float]], scales: dict[str, float]) -> list[Array]:
        """The next frame of the scratch file as uint8 pictures."""
        shape = self._shape
        tiles = [self._next(np.uint8, (*shape, 3))] if self._rgb else []
        alpha = self._next(np.uint8, (*shape, 1)).astype(np.float32) / 255
        scalars = 0
        for panel, span in zip(self._panels, ranges, strict=True):
            planes = dequantise(self._next(np.uint16, (panel.channels, *shape)), *span) / np.float32(scales[panel.name])
            colour = vectors(planes) if panel.channels == 2 else scalar(planes, COLOURS[scalars % len(COLOURS)])
            scalars += panel.channels != 2
            tiles.append((255 * (1 - alpha) + colour * alpha + 0.5).astype(np.uint8))
        return tiles

    def _next(self, kind: type[np.generic], shape: tuple[int, ...]) -> Array:
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        return np.frombuffer(self._scratch.read(size), dtype=kind).reshape(shape)


def amount(value: float, unit: str) -> str:
    """A value with three digits and its unit, as 4.87 kPa."""
    if unit == "1":
        return f"{value:.3g}"
    for prefix, factor in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if value >= factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"


def scalar(planes: Array, colours: str) -> Array:
    """Colours 0..255 of values in [0, 1], planes [C, H, W] to [H, W, 3]; several channels show their length."""
    length = planes[0] if len(planes) == 1 else np.linalg.norm(planes, axis=0)
    return np.asarray(_table(colours)[(np.clip(length, 0, 1) * 255).astype(np.uint8)])


def vectors(planes: Array) -> Array:
    """Colours 0..255 of (right, up) vectors up to 1 long, [2, H, W] to [H, W, 3]: direction as hue on light grey.

    The saturation is the root of the length, because the recoil after a break is several times as fast as the pull.
    """
    right, up = planes
    turn = np.arctan2(-up, right) * np.float32(128 / np.pi)
    hue = _table("hsv")[np.floor(turn).astype(np.int32) % 256]
    saturation = np.sqrt(np.minimum(np.hypot(right, up), 1))[..., None]
    return np.asarray(225 + (hue - 225) * saturation)


@cache
def _table(name: str) -> Array:
    """256 colours, [256, 3] float32 in 0..255."""
    from matplotlib import colormaps  # here, because matplotlib takes long to load

    return np.asarray(colormaps[name](np.arange(256))[:, :3] * 255, np.float32)


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=14)


def _stamped(header: Image.Image, text: str) -> Array:
    picture = header.copy()
    ImageDraw.Draw(picture).text((GAP + 40, 4), text, fill=GREY, font=_font())
    return np.array(picture)
