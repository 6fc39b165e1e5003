"""strip.mp4: colour and maps side by side, for people.

The colours need the largest value of the clip, known only at the end, so small frames are kept in a scratch file.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fracsim.records import Array
from fracsim.sample.coverage import FAINT
from fracsim.sample.header import Header
from fracsim.sample.quantise import dequantise, quantise, split
from fracsim.sample.video import Encoder

WIDEST = 320
"""Panels are reduced by a whole factor until they are no wider [px]."""
LINE, MARGIN, GAP = 18, 6, 4
"""Height of a line of the labels, of the space around them, and width of that between panels [px]."""
CLOCK = "t = 00.000 s"
"""As wide as the time of a frame."""
GREY = "#606060"
COLOURS = ("viridis", "inferno", "plasma", "cividis")
"""Matplotlib colour maps of the scalar maps, in turn."""


def reduction(width: int) -> int:
    """Whole factor by which pictures of this width shrink."""
    return -(-width // WIDEST)


def top(strip: int, panel: int) -> int:
    """The first row of the panels of a strip of this height, which are `panel` high [px]; the height is even."""
    below = panel + GAP
    return strip - below - below % 2


class Strip:
    """Collects frames of a sample and encodes them."""

    def __init__(self, folder: Path, header: Header) -> None:
        self._factor = reduction(header.width)
        self._shape = -(-header.height // self._factor), -(-header.width // self._factor)
        self._header = header
        self._title = LINE + MARGIN
        self._peaks = dict.fromkeys(header.maps, 0.0)
        self._ranges: list[list[tuple[float, float]]] = []
        self._scratch_path = folder / "strip.scratch"
        self._scratch = self._scratch_path.open("wb+")

    def add(self, rgb: Array | None, alpha: Array | None, maps: Mapping[str, Array]) -> None:
        """Append a frame: rgb uint8 [H, W, 3], alpha [H, W] (None: all is covered), planes of the maps, [C, H, W]."""
        coverage: Array = np.ones(self._shape, np.float32)
        ranges = []
        if rgb is not None:
            self._scratch.write(self._small(rgb).tobytes())
        if alpha is not None:
            coverage = self._small(np.asarray(alpha, np.float32))
            self._scratch.write((np.clip(coverage, 0, 1) * 255 + 0.5).astype(np.uint8).tobytes())
        covered = coverage > FAINT
        for name in self._header.maps:
            # The quantity itself, not the quantity times its coverage: no dark rim where coverage fades.
            planes = np.stack([self._small(plane) for plane in maps[name]]) / np.maximum(coverage, FAINT)
            magnitude = np.sqrt((planes[:, covered] ** 2).sum(axis=0))
            if magnitude.size:  # a single wild particle must not make the clip dark
                self._peaks[name] = max(self._peaks[name], float(np.percentile(magnitude, 99.5)))
            codes, span = quantise(split(planes)[0])
            self._scratch.write(codes.tobytes())
            ranges.append(span)
        self._ranges.append(ranges)

    def _small(self, picture: Array) -> Array:
        """`picture`, uint8 [H, W, 3] or float32 [H, W], averaged over blocks."""
        return np.asarray(Image.fromarray(picture).reduce(self._factor))

    def encode(self, path: Path) -> None:
        """Write the strip and drop the scratch file; raises OSError when the disk is full."""
        h, w = self._shape
        tiles = self._header.rgb + len(self._header.maps)
        scales = {name: info.scale or self._peaks[name] or 1.0 for name, info in self._header.maps.items()}
        fits = all(_font().getlength(label + full) + 3 * GAP <= w for label, full in self._texts(scales))
        self._title = (1 if fits else 2) * LINE + MARGIN
        width, height = tiles * (w + GAP) + GAP, self._title + h + GAP
        background = self._background(width + width % 2, height + height % 2, scales)
        plain = np.array(background)
        self._scratch.seek(0)
        with Encoder(path, width + width % 2, height + height % 2, "strip") as encoder:
            for index, ranges in enumerate(self._ranges):
                picture = self._stamped(background, plain, f"t = {index / self._header.fps:.3f} s")
                for k, tile in enumerate(self._tiles(ranges, scales)):
                    left = GAP + k * (w + GAP)
                    picture[self._title : self._title + h, left : left + w] = tile
                encoder.write(picture)
        self.close()

    def close(self) -> None:
        """Drop the scratch file."""
        self._scratch.close()
        self._scratch_path.unlink(missing_ok=True)

    def _background(self, width: int, height: int, scales: dict[str, float]) -> Image.Image:
        """A white picture with lines between the panels, their names, and what their full colours mean."""
        picture = Image.new("RGB", (width, height), "white")
        draw, step = ImageDraw.Draw(picture), self._shape[1] + GAP
        below = self._title - MARGIN - LINE  # in a line of its own where a panel is too narrow for one
        for k, (label, full) in enumerate(self._texts(scales)):
            draw.text((GAP + k * step + 4, 4), label, fill="black", font=_font())
            if full != CLOCK:
                draw.text(((k + 1) * step - 4, 4 + below), full, fill=GREY, font=_font(), anchor="ra")
            if k:
                draw.line([k * step + GAP // 2, 0, k * step + GAP // 2, height], fill="#d8d8d8")
        return picture

    def _texts(self, scales: dict[str, float]) -> list[tuple[str, str]]:
        """The name of each panel, and what is said beside it: the time, or what the full colour means."""
        texts = [("rgb", CLOCK)] if self._header.rgb else []
        return texts + [(i.label, f"0 to {amount(scales[name], i.unit)}") for name, i in self._header.maps.items()]

    def _stamped(self, background: Image.Image, plain: Array, time: str) -> Array:
        """A copy of the background, `plain` uint8 [H, W, 3], with the time of a frame behind the first label."""
        picture: Array = plain.copy()
        if self._header.rgb:
            left, top = (GAP + 40, 4) if self._title == LINE + MARGIN else (GAP + 4, 4 + LINE)
            stamp = background.crop((left, top, background.width, top + LINE))
            ImageDraw.Draw(stamp).text((0, 0), time, fill=GREY, font=_font())
            picture[top : top + LINE, left:] = stamp
        return picture

    def _tiles(self, ranges: list[tuple[float, float]], scales: dict[str, float]) -> list[Array]:
        """The next frame of the scratch file as uint8 pictures."""
        pixels = self._shape[0] * self._shape[1]
        alpha: Array = np.full(pixels, 255, np.uint8)
        tiles, scalars = [], 0
        if self._header.rgb:
            tiles.append(self._next(np.uint8, (*self._shape, 3)))
        if self._header.alpha:
            alpha = self._next(np.uint8, (pixels,))
        covered = np.flatnonzero(alpha)  # most pixels are empty and need no arithmetic
        share = alpha[covered, None] / np.float32(255)
        white = 255 * (1 - share) + np.float32(0.5)
        for (name, info), span in zip(self._header.maps.items(), ranges, strict=True):
            codes = self._next(np.uint16, (info.channels, pixels))[:, covered]
            planes = dequantise(codes, *span) / np.float32(scales[name])
            colour = vectors(planes) if info.channels == 2 else scalar(planes, COLOURS[scalars % len(COLOURS)])
            scalars += info.channels != 2
            tile: Array = np.full((pixels, 3), 255, np.uint8)
            tile[covered] = white + colour * share
            tiles.append(tile.reshape(*self._shape, 3))
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
    """Colours 0..255 of values in [0, 1], planes [C, ...] to [..., 3]; several channels show their length."""
    length = planes[0] if len(planes) == 1 else np.linalg.norm(planes, axis=0)
    return np.asarray(_table(colours)[(np.clip(length, 0, 1) * 255).astype(np.uint8)])


def vectors(planes: Array) -> Array:
    """Colours 0..255 of (right, up) vectors up to 1 long, [2, ...] to [..., 3]: direction as hue on light grey.

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
