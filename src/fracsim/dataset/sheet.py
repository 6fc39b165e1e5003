"""A contact sheet: one clip for each pair of values of two parameters, so that one sees what they do.

    python -m fracsim.dataset sheet DIR --by fracture.onset --by fracture.crit
    python -m fracsim.dataset sheet DIR --by material.E --by loading.speed --map stress --only asset.name=duck
    python -m fracsim.dataset sheet DIR --by asset.name --by seed --at break --out sheet.png --video sheet.mp4

The first parameter has a row a value, the second a column. Where several clips have the same two values the first is
shown, and their number is written below it. All cells show the same frame, or with `--at break` each its own; a map
has one scale for all cells. `--video` shows all frames.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fracsim.dataset.cells import Cell, collect
from fracsim.dataset.page import Key, Page
from fracsim.records import Array
from fracsim.sample.coverage import FAINT
from fracsim.sample.strip import amount, scalar, vectors
from fracsim.sample.video import Encoder
from fracsim.scene.knob import describe, text
from fracsim.scene.vocab import Scene

MOST = 24
"""Most rows, and most columns."""
COLOURS = "viridis"
"""Colours of a scalar map."""
CHUNK = 8
"""Frames decoded at a time."""
SPREAD = 12
"""Frames of a clip that the scale of a video is taken from."""
KNOBS = {name: knob for name, _, knob in describe(Scene)}


@dataclass
class Sheet:
    """Cells by the values of two parameters, and how they are shown."""

    by: tuple[str, str]
    """Parameters of the rows and of the columns."""
    cells: dict[Key, Cell]
    what: str = "rgb"
    """rgb, or the name of a map."""
    at: int | str = "middle"
    """A frame; "break": each clip in the frame of its own break; "middle": all in the median of these frames."""
    width: int = 200
    """Pictures are reduced by a whole factor until they are no wider [px]."""
    only: Mapping[str, str] = field(default_factory=dict)
    """What all clips have in common, for the caption."""

    def __post_init__(self) -> None:
        for name, values in zip(self.by, (self.rows, self.columns), strict=True):
            if len(values) > MOST:
                raise ValueError(f"--by {name} has {len(values)} values, and a sheet at most {MOST} rows and columns: "
                                 f"take another parameter, or leave some out by --only {name}=VALUE.")  # fmt: skip
        for cell in self.cells.values():
            if self.what != "rgb" and self.what not in cell.sample.meta["maps"]:
                known = ", ".join(["rgb", *cell.sample.meta["maps"]])
                raise ValueError(f"--map {self.what} was not recorded in {cell.sample.path}: choose one of {known}.")

    @property
    def rows(self) -> list[Any]:
        """Values of the first parameter."""
        return sorted({row for row, _ in self.cells}, key=_order)

    @property
    def columns(self) -> list[Any]:
        """Values of the second parameter."""
        return sorted({column for _, column in self.cells}, key=_order)

    @cached_property
    def middle(self) -> int:
        """Median of the frames in which the clips break; half of the frames when none does."""
        broken = sorted(c.breaks for c in self.cells.values() if c.breaks is not None)
        return broken[len(broken) // 2] if broken else max(c.sample.frames for c in self.cells.values()) // 2

    def frame(self, cell: Cell) -> int:
        """The frame that the picture shows of a clip."""
        wanted = self.at if isinstance(self.at, int) else self.middle
        if self.at == "break" and cell.breaks is not None:
            wanted = cell.breaks
        return min(wanted, cell.sample.frames - 1)

    def png(self, path: Path) -> None:
        """Write the sheet as a picture."""
        frames = {key: self._values(cell, self.frame(cell), self.frame(cell) + 1) for key, cell in self.cells.items()}
        scale = max(map(_largest, frames.values()))
        pictures = {key: self._coloured(values, scale)[0] for key, values in frames.items()}
        when = "each clip in the frame of its own break" if self.at == "break" else self._time(self._shown)
        Image.fromarray(self._page(pictures).draw(pictures, self._caption(when, scale))).save(path)

    def video(self, path: Path) -> None:
        """Write the sheet as a film of all frames; a clip that is shorter keeps its last frame."""
        scale = max(_largest(self._spread(cell)) for cell in self.cells.values())
        films = {key: self._film(cell, scale) for key, cell in self.cells.items()}
        page = self._page({key: film[0] for key, film in films.items()})

        def drawn(k: int) -> Array:
            now = {key: film[min(k, len(film) - 1)] for key, film in films.items()}
            return page.draw(now, self._caption(self._time(k), scale))

        height, width, _ = drawn(0).shape
        with Encoder(path, width, height, "strip") as encoder:
            for k in range(max(map(len, films.values()))):
                encoder.write(drawn(k))

    @property
    def _shown(self) -> int:
        return self.at if isinstance(self.at, int) else self.middle

    def _caption(self, when: str, scale: float) -> str:
        common = "".join(f"; {name}={value}" for name, value in self.only.items())
        return f"{when}; {self._legend(scale)}{common}"

    def _time(self, k: int) -> str:
        fps = {cell.sample.meta["fps"] for cell in self.cells.values()}
        return f"frame {k}, t = {k / fps.pop():.3f} s" if len(fps) == 1 else f"frame {k}"

    @property
    def _scalar(self) -> bool:
        """Whether the pictures have a colour scale."""
        sample = next(iter(self.cells.values())).sample
        return self.what != "rgb" and sample.meta["maps"][self.what]["channels"] == 1

    def _legend(self, scale: float) -> str:
        """What the colours mean."""
        if self.what == "rgb":
            return "colour"
        info = next(iter(self.cells.values())).sample.meta["maps"][self.what]
        how = "direction as hue, " if info["channels"] == 2 else ""
        return f"{info['label']}, {how}0 to {amount(scale, info['unit'])} in all cells"

    def _film(self, cell: Cell, scale: float) -> Array:
        """All frames of a clip, small, [T, h, w, 3] uint8."""
        starts = range(0, cell.sample.frames, CHUNK)
        parts = [self._values(cell, k, min(k + CHUNK, cell.sample.frames)) for k in starts]
        return np.concatenate([self._coloured(part, scale) for part in parts])

    def _spread(self, cell: Cell) -> Array:
        """A few frames of a clip, for the scale."""
        if self.what == "rgb":
            return np.zeros((1, 1, 1, 1), np.float32)
        frames = np.unique(np.linspace(0, cell.sample.frames - 1, SPREAD).astype(int))
        return np.concatenate([self._values(cell, k, k + 1) for k in frames.tolist()])

    def _values(self, cell: Cell, start: int, stop: int) -> Array:
        """Frames of a clip, small: colour uint8 [T, h, w, 3], or a map and its coverage float32 [T, h, w, C + 1]."""
        sample = cell.sample
        found = sample.read(self.what, start, stop)
        factor = -(-found.shape[2] // self.width)
        if self.what == "rgb":
            return np.stack([np.asarray(Image.fromarray(picture).reduce(factor)) for picture in found])
        alpha = sample.read("alpha", start, stop) if sample.meta["alpha"] else np.ones(found.shape[:3], np.float32)
        planes = np.moveaxis(np.concatenate([found, alpha[..., None]], axis=-1), -1, 1)
        small = np.stack([[np.asarray(Image.fromarray(p).reduce(factor)) for p in frame] for frame in planes])
        small[:, :-1] /= np.maximum(small[:, -1:], FAINT)  # the quantity itself, without a dark rim
        return np.asarray(np.moveaxis(small, 1, -1))

    def _coloured(self, values: Array, scale: float) -> Array:
        """Pictures uint8 [T, h, w, 3] of what `_values` gives."""
        if self.what == "rgb":
            return values
        out = np.empty((*values.shape[:3], 3), np.uint8)
        for k, frame in enumerate(values):
            planes, alpha = np.moveaxis(frame[..., :-1], -1, 0) / np.float32(scale or 1.0), frame[..., -1:]
            colour = vectors(planes) if len(planes) == 2 else scalar(planes, COLOURS)
            out[k] = np.clip(255 * (1 - alpha) + colour * alpha + 0.5, 0, 255)
        return out

    def _page(self, pictures: Mapping[Key, Array]) -> Page:
        """The page that holds these pictures."""
        height, width = np.max([p.shape[:2] for p in pictures.values()], axis=0).tolist()
        rows, columns = ({value: label(name, value) for value in values}
                         for name, values in zip(self.by, (self.rows, self.columns), strict=True))  # fmt: skip
        return Page(rows, columns, {key: cell.words for key, cell in self.cells.items()},
                    (f"rows: {about(self.by[0])}", f"columns: {about(self.by[1])}"), (height, width),
                    COLOURS if self._scalar else "")  # fmt: skip


def _order(value: Any) -> tuple[bool, float, str]:
    """Numbers by value, then texts."""
    number = isinstance(value, (int, float))
    return not number, float(value) if number else 0.0, "" if number else text(value)


def label(name: str, value: Any) -> str:
    """A value with its unit, as 6 kPa."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return amount(float(value), KNOBS[name].unit or "1")
    return text(value)


def about(name: str) -> str:
    """A parameter and what it means."""
    return f"{name}, {KNOBS[name].doc}"


def _largest(values: Array) -> float:
    """The largest magnitude of a map where something is seen, without single wild particles."""
    magnitude = np.linalg.norm(values[..., :-1], axis=-1)[values[..., -1] > FAINT]
    return float(np.percentile(magnitude, 99.5)) if magnitude.size else 0.0


def add(subparsers: Any) -> None:
    """Add the command to `python -m fracsim.dataset`."""
    about = "a contact sheet of two parameters, as PNG and as MP4"
    parser = subparsers.add_parser("sheet", help=about, description=about)
    parser.add_argument("folder", type=Path, metavar="DIR", help="folder of a data set")
    parser.add_argument("--by", action="append", required=True, metavar="FIELD",
                        help="twice: the parameter of the rows and that of the columns, as material.E")  # fmt: skip
    parser.add_argument("--map", default="rgb", metavar="NAME", help="rgb (default), or a map, as stress")
    when = parser.add_mutually_exclusive_group()
    when.add_argument("--frame", type=int, metavar="K", help="show frame K of every clip")
    when.add_argument("--at", choices=("middle", "break"), default="middle",
                      help="the median of the break frames (default), or each clip at its own break")  # fmt: skip
    parser.add_argument("--only", action="append", default=[], metavar="FIELD=VALUE", help="leave out other clips")
    parser.add_argument("--width", type=int, default=200, metavar="PX", help="widest picture (200)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="the PNG (DIR/sheets/ROWS-COLUMNS-MAP.png)")
    parser.add_argument("--video", type=Path, metavar="FILE", help="also an MP4 of all frames")
    parser.set_defaults(run=main)


def main(arguments: argparse.Namespace) -> int:
    """Write the sheet and print where it lies; returns 0. Raises ValueError for bad parameters."""
    rows, columns = _two(arguments.by)
    only = dict(_pair(word) for word in arguments.only)
    if (arguments.frame is not None and arguments.frame < 0) or arguments.width < 16:
        raise ValueError(f"--frame {arguments.frame} --width {arguments.width}: a frame is at least 0, a width 16.")
    at = arguments.at if arguments.frame is None else arguments.frame
    cells = collect(arguments.folder, (rows, columns), only)
    sheet = Sheet((rows, columns), cells, arguments.map, at, arguments.width, only)
    out = arguments.out or arguments.folder / "sheets" / f"{rows}-{columns}-{arguments.map}.png"
    out.parent.mkdir(parents=True, exist_ok=True)
    sheet.png(out)
    print(out)
    if arguments.video:
        arguments.video.parent.mkdir(parents=True, exist_ok=True)
        sheet.video(arguments.video)
        print(arguments.video)
    return 0


def _two(by: Sequence[str]) -> tuple[str, str]:
    if len(by) != 2:
        raise ValueError(f"--by was given {len(by)} times: give it twice, for rows and columns.")
    return by[0], by[1]


def _pair(word: str) -> tuple[str, str]:
    name, sign, value = word.partition("=")
    if not sign:
        raise ValueError(f"--only {word}: write FIELD=VALUE, as asset.name=duck.")
    return name, value
