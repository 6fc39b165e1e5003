"""A page of pictures in rows and columns: headings, words below each picture, lines above and below all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fracsim.records import Array
from fracsim.sample.strip import scalar

PAD, LINE, FONT = 8, 18, 13
"""Space around things, height of a line, size of the letters [px]."""
NARROWEST = 360
"""Least width of a page [px]."""
GREY, PALE = "#606060", "#eeeeee"
BAR = 100
"""Width of the colour scale [px]."""
Key = tuple[Any, Any]
"""Value of the row and of the column."""


@dataclass(frozen=True)
class Page:
    """What stands around the pictures; pictures may be missing."""

    rows: Mapping[Any, str]
    """Headings of the rows by value, from above."""
    columns: Mapping[Any, str]
    """Headings of the columns by value, from the left."""
    words: Mapping[Key, str]
    """What is written below a picture."""
    head: Sequence[str]
    """Paragraphs above all."""
    size: tuple[int, int]
    """Height and width of a picture [px]."""
    colours: str = ""
    """Colour map of the scale beside the caption, "" for none."""

    @property
    def left(self) -> int:
        """Where the first column begins [px]."""
        return max(map(_wide, self.rows.values())) + 2 * PAD

    @property
    def step(self) -> int:
        """From one column to the next [px]."""
        return max(self.size[1], *map(_wide, self.words.values()), *map(_wide, self.columns.values())) + PAD

    @property
    def width(self) -> int:
        """Width of the page, even [px]."""
        width = max(self.left + self.step * len(self.columns), NARROWEST)
        return width + width % 2

    def draw(self, pictures: Mapping[Key, Array], caption: str) -> Array:
        """The page with pictures, uint8 [h, w, 3], and a caption: uint8 [H, W, 3], H and W even."""
        head = [line for paragraph in self.head for line in _wrapped(paragraph, self.width - 2 * PAD)]
        indent = PAD + (BAR + PAD if self.colours else 0)
        foot = _wrapped(caption, self.width - indent - PAD)
        top = PAD + LINE * (len(head) + 1) + PAD
        end = top + (self.size[0] + LINE + PAD) * len(self.rows)
        height = end + LINE * len(foot) + PAD
        page = Image.new("RGB", (self.width, height + height % 2), "white")
        pen = ImageDraw.Draw(page)
        _lines(pen, PAD, PAD, head)
        _lines(pen, indent, end, foot)
        if self.colours:
            page.paste(_ramp(self.colours), (PAD, end + 3))
        self._grid(page, pen, top, pictures)
        return np.array(page)

    def _grid(self, page: Image.Image, pen: ImageDraw.ImageDraw, top: int, pictures: Mapping[Key, Array]) -> None:
        """Draw headings, pictures, and the words below them."""
        h, w = self.size
        for j, heading in enumerate(self.columns.values()):
            _centred(pen, self.left + j * self.step + w / 2, top - LINE, heading, "black")
        for i, (row, heading) in enumerate(self.rows.items()):
            y = top + i * (h + LINE + PAD)
            pen.text((self.left - PAD, y + h / 2), heading, fill="black", font=_font(), anchor="rm")
            for j, column in enumerate(self.columns):
                x, picture = self.left + j * self.step, pictures.get((row, column))
                if picture is not None:
                    page.paste(Image.fromarray(picture), (x, y))
                pen.rectangle((x, y, x + w - 1, y + h - 1), outline=PALE, fill=PALE if picture is None else None)
                _centred(pen, x + w / 2, y + h + 2, self.words.get((row, column), ""), GREY)


def _centred(pen: ImageDraw.ImageDraw, x: float, y: float, words: str, colour: str) -> None:
    pen.text((x, y), words, fill=colour, font=_font(), anchor="ma")


def _lines(pen: ImageDraw.ImageDraw, x: int, y: int, lines: Sequence[str]) -> None:
    for k, line in enumerate(lines):
        pen.text((x, y + k * LINE), line, fill=GREY, font=_font())


def _ramp(colours: str) -> Image.Image:
    """The colours of a scalar map from 0 on the left to its largest value."""
    values = np.broadcast_to(np.linspace(0, 1, BAR, dtype=np.float32), (1, LINE - 6, BAR))
    return Image.fromarray(scalar(values, colours).astype(np.uint8))


@cache
def _font() -> Any:
    return ImageFont.load_default(size=FONT)


def _wide(words: str) -> int:
    """Width of a line [px]."""
    return int(_font().getlength(words)) + 2


def _wrapped(words: str, width: int) -> list[str]:
    """Lines no wider than `width` [px]."""
    lines = [""]
    for word in words.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and _wide(longer) > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines
