"""A sheet of thumbnails: one frame a clip, with its object and what happens to it."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from fracsim.dataset.reader import Clip, Clips
from fracsim.records import Array

MOST, COLUMNS, SIZE, TITLE = 60, 10, 128, 14
"""Most clips on a sheet, clips in a row, largest edge of a picture [px], height of its title [px]."""
AFTER = 3
"""A clip is shown this many frames after its break, when the pieces are apart."""


def chosen(clips: Clips) -> Clips:
    """At most MOST clips, evenly spread over the table sorted by object."""
    order = sorted(range(len(clips)), key=lambda k: (clips.table["object"][k].as_py(), k))
    return clips.take(order[:: -(-len(order) // MOST)] if order else order)


def sheet(clips: Iterable[Clip], path: Path) -> bool:
    """Save one picture of each clip to `path`; False when no clip has any."""
    tiles = [tile for tile in map(_tile, clips) if tile is not None]
    if not tiles:
        return False
    path.parent.mkdir(exist_ok=True)
    _joined(tiles).save(path)
    return True


def _tile(clip: Clip) -> Image.Image | None:
    """A thumbnail with a title; None for a clip without pictures, or one that cannot be read."""
    frame = _frame(clip)
    if frame is None:
        return None
    picture = Image.fromarray(frame)
    picture.thumbnail((SIZE, SIZE))
    tile = Image.new("RGB", (SIZE, SIZE + TITLE), "white")
    tile.paste(picture, ((SIZE - picture.width) // 2, TITLE + (SIZE - picture.height) // 2))
    broken = clip.row["break_frame"]
    title = f"{clip.row['object']}, {'holds' if broken is None else f'breaks at {broken}'}"
    ImageDraw.Draw(tile).text((2, 1), title, fill="black", font=ImageFont.load_default(size=10))
    return tile


def _frame(clip: Clip) -> Array | None:
    """A frame of a clip, uint8 [H, W, 3]: its colour, or the length of its first map in grey; None without both."""
    broken, last = clip.row["break_frame"], clip.row["frames"] - 1
    k = last if broken is None else min(broken + AFTER, last)
    try:
        if clip.row["rgb_file_name"]:
            return np.asarray(clip.read("rgb", k, k + 1)[0])
        name = next(iter(clip.sample.meta["maps"]), None)
        if name is None:
            return None
        length = np.linalg.norm(clip.read(name, k, k + 1)[0], axis=-1)
    except ValueError:
        return None
    grey = (255 * length / max(float(length.max()), 1e-30)).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=-1)


def _joined(tiles: Sequence[Image.Image]) -> Image.Image:
    """Tiles of one size in rows of COLUMNS."""
    width, height = tiles[0].size
    columns = min(COLUMNS, len(tiles))
    out = Image.new("RGB", (columns * width, -(-len(tiles) // columns) * height), "white")
    for k, tile in enumerate(tiles):
        out.paste(tile, (k % columns * width, k // columns * height))
    return out
