"""Reads a sample folder; arrays are in physical units and are decoded at first use."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np

from fracsim.records import Array
from fracsim.sample import chunked, coverage, notebook, schema
from fracsim.sample.folder import lacking
from fracsim.sample.identity import FRACSIM, canonical, sample_id, scene_content
from fracsim.sample.lazy import Maps as Maps
from fracsim.sample.quantise import LEVELS, dequantise
from fracsim.sample.video import count, decode
from fracsim.scene.vocab import Scene


class Tracks(NamedTuple):
    """Projected paths of M particles over T frames."""

    xy: Array
    """Pixel positions, x right and y down from the top left corner [px], (T, M, 2) float32."""
    visible: Array
    """Whether the particle is seen, (T, M) bool."""
    particles: Array
    """Indices of the particles, (M,) int64."""


@dataclass(frozen=True, repr=False)
class Sample:
    """A sample on disk; T = `frames`. Arrays that were not recorded, or whose file is damaged, raise ValueError."""

    path: Path
    meta: dict[str, Any]
    """The entries of meta.json: id, producer, content, view, units and ranges of the maps, provenance, report."""
    frames: int
    """Frames that can be read; of an incomplete sample, those that are whole in every file."""

    def __repr__(self) -> str:
        meta, (width, height) = self.meta, self.meta["size"]
        state = "complete" if self.complete else f"incomplete ({meta['reason']})"
        recorded = [name for name in ("rgb", "alpha") if meta[name]]
        recorded += [f"{name} [{entry['unit']}]" for name, entry in meta["maps"].items()]
        return (
            f"Sample {meta['id']} of {meta['producer']}, {state}, in {self.path}\n"
            f"{self.frames} frames at {meta['fps']:g} a second, {width} x {height} pixels\n"
            f"{', '.join(recorded) or 'no pictures'}"
        )

    def _repr_html_(self) -> str:
        """The same for a notebook, with the film."""
        return notebook.html(repr(self), self.path / schema.STRIP)

    @property
    def complete(self) -> bool:
        """Whether the sample has all that its producer announced."""
        return bool(self.meta["complete"])

    @property
    def producer(self) -> str:
        """Name of the program behind the sample, as fracsim."""
        return str(self.meta["producer"])

    @cached_property
    def document(self) -> dict[str, Any]:
        """What makes the sample again, as a mapping; of a simulated sample the resolved scene."""
        return schema.load_document(self.path / self.meta["document"])

    @cached_property
    def scene(self) -> Scene:
        """The resolved scene of a simulated sample; raises ValueError for another producer."""
        if self.producer != FRACSIM:
            raise ValueError(
                f"{self.path} is not simulated but made by {self.producer}: it has a `document`, no scene."
            )
        return schema.load_scene(self.path / schema.SCENE)

    @cached_property
    def rgb(self) -> Array:
        """Colour, [T, H, W, 3] uint8."""
        return self.read("rgb")

    @cached_property
    def alpha(self) -> Array:
        """How much of each pixel the object covers, in [0, 1], [T, H, W] float32."""
        return self.read("alpha")

    @cached_property
    def maps(self) -> Maps:
        """Physics maps in physical units as they lie on disk, [T, H, W, C] float32 each; exactly 0 without object.

        A pixel holds the quantity times its coverage (Eq. 6), like colour on black, so that it fades where the object
        ends: `maps_over_alpha` has the quantity itself.
        """
        return Maps(tuple(self.meta["maps"]), self.read)

    @cached_property
    def maps_over_alpha(self) -> Maps:
        """Physics maps over their coverage, [T, H, W, C] float32 each: the quantity itself, up to the object's edge.

        Exactly 0 where `alpha` is below `coverage.FAINT` = 0.05. Equal to `maps` when no alpha was recorded.
        """
        return Maps(tuple(self.meta["maps"]), lambda name: self.read(name, over_alpha=True))

    def read(self, what: str, start: int = 0, stop: int | None = None, over_alpha: bool = False) -> Array:
        """Frames start .. stop - 1 (default: all) of "rgb", "alpha" or a map, [T, ...] as `rgb`, `alpha` and `maps`.

        With `over_alpha` a map is that of `maps_over_alpha`. Decodes these frames only and keeps nothing. Raises
        ValueError for a range that is empty or not within 0 .. frames, for what was not recorded, and for damage within
        the range.
        """
        values = self._values(what, start, stop)
        if over_alpha and what in self.meta["maps"] and self.meta["alpha"]:
            return coverage.over_alpha(values, self._values("alpha", start, stop))
        return values

    def _values(self, what: str, start: int, stop: int | None) -> Array:
        """Frames start .. stop - 1 of "rgb", "alpha" or a map as it lies on disk, in its unit."""
        codes = self.stored(what, start, stop)
        if what == "rgb":
            return codes
        if what == "alpha":
            return np.asarray(codes / np.float32(LEVELS))
        ranges = self.meta["ranges"][what][start:stop]
        count, channels, height, width = codes.shape
        values = np.empty((count, height, width, channels), np.float32)
        for k, c in np.ndindex(count, channels):
            values[k, ..., c] = dequantise(codes[k, c], *ranges[k][c])
        for frame, c, row, column, value in self.meta["outliers"][what]:
            if start <= frame < start + count:
                values[frame - start, row, column, c] = value
        return values

    def stored(self, what: str, start: int = 0, stop: int | None = None) -> Array:
        """As `read`, but as it lies on disk: "rgb" uint8 [T, H, W, 3], "alpha" uint16 [T, H, W], maps [T, C, H, W].

        Coverage is code / 65535, a map is lo + code / 65535 (hi - lo); meta["ranges"][what][frame][channel] is lo, hi.
        Few values far beyond the others have no code: meta["outliers"][what] lists frame, channel, row, column, value.
        """
        stop = self.frames if stop is None else stop
        if not 0 <= start < stop <= self.frames and (start, stop) != (0, self.frames):
            raise ValueError(f"frames {start} to {stop} of {what} cannot be read: {self.path} has frames 0 to "
                             f"{self.frames}, and start must be below stop.")  # fmt: skip
        if what not in ("rgb", "alpha", *self.meta["maps"]):
            known = [name for name in ("rgb", "alpha") if self.meta[name]] + list(self.meta["maps"])
            raise ValueError(f"{what} was not recorded in {self.path}: read one of {', '.join(known) or 'nothing'}.")
        if what in ("rgb", "alpha") and not self.meta[what]:
            raise ValueError(f"{self.path} has no {what}: {self._why_without(what)}.")
        return self._stored(what, start, stop)

    def _stored(self, what: str, start: int, stop: int) -> Array:
        """Frames start .. stop - 1 of what is there, decoded."""
        if self.meta.get("storage") == chunked.STORAGE:
            return chunked.read(self._file(chunked.file(what)), start, stop)
        if what == "rgb":
            return self._decode(schema.RGB, "rgb", start, stop)
        if what == "alpha":
            return self._decode(schema.ALPHA, "gray16", start, stop)
        channels = self.meta["maps"][what]["channels"]
        codes = self._decode(schema.map_file(what), "gray16", start, stop, channels)
        return codes.reshape(len(codes), channels, -1, codes.shape[-1])

    @cached_property
    def tracks(self) -> Tracks:
        """Paths of the tracked particles."""
        with self._arrays(schema.TRACKS) as arrays:
            return Tracks(arrays["xy"][: self.frames], arrays["visible"][: self.frames], arrays["particles"])

    @cached_property
    def history(self) -> dict[str, Array]:
        """The curves of report.png by name, 1-D arrays."""
        with self._arrays(schema.HISTORY) as arrays:
            return dict(arrays)

    def _why_without(self, what: str) -> str:
        if self.producer != FRACSIM:
            return f"{self.producer} did not record it"
        return "it was made with capture.rgb=false" + (" and capture.maps=[]" if what == "alpha" else "")

    def _decode(self, name: str, codec: str, start: int, stop: int, stacked: int = 1) -> Array:
        width, height = self.meta["size"]
        frames = decode(self._file(name), width, height * stacked, codec, start, stop)
        if len(frames) < stop - start:
            raise ValueError(f"{self.path / name} is damaged: {len(frames)} of {stop - start} frames can be decoded. "
                             "Make the sample again, or read it with allow_incomplete=True.")  # fmt: skip
        return frames

    def _arrays(self, name: str) -> Any:
        path = self._file(name)
        try:
            return np.load(path)
        except (OSError, EOFError, ValueError, BadZipFile) as error:
            raise ValueError(f"{path} is damaged: {error}. Make the sample again.") from None

    def _file(self, name: str) -> Path:
        if not (self.path / name).is_file():
            raise ValueError(f"{self.path} has no {name}: its producer did not record it, or it was not finished.")
        return self.path / name


def read(path: Path | str, allow_incomplete: bool = False) -> Sample:
    """Open the sample in the folder `path`; with `allow_incomplete` also an unfinished or damaged one.

    Raises ValueError when it is no sample, of another schema version, incomplete, or misses files.
    """
    folder = Path(path).expanduser()
    meta = schema.read_meta(folder)
    if not meta["complete"] and not allow_incomplete:
        raise ValueError(f"{folder} is incomplete ({meta['reason']}): make it again, or read what is there with "
                         "allow_incomplete=True.")  # fmt: skip
    lost = lacking(folder, meta)
    if lost and not allow_incomplete:
        raise ValueError(f"{folder} is damaged: {', '.join(lost)} missing or cut short. Make the sample again, "
                         "or read what is there with allow_incomplete=True.")  # fmt: skip
    if meta["complete"] and not lost:
        return Sample(folder, meta, meta["frames"])
    if (folder / schema.JOURNAL).is_file():
        _recover(folder, meta)
    return Sample(folder, meta, _readable(folder, meta))


def verify(path: Path | str) -> list[str]:
    """What is wrong with a sample, a sentence each; empty when every file is as it was written.

    Hashes all files again, and what the id stands for; samples of version 1 did not store that.
    """
    folder = Path(path).expanduser()
    try:
        meta = schema.read_meta(folder)
        problems = [] if meta["complete"] else [f"incomplete: {meta['reason']}"]
        if meta["schema"] > 1:
            problems += _mismatches(folder, meta)
        # The files of a sample that was never finished are not listed.
        return problems + (_differences(meta["files"], schema.inventory(folder)) if meta["files"] else [])
    except (ValueError, OSError) as error:
        return [str(error)]
    except (KeyError, TypeError) as error:
        return [f"{schema.META} lacks {error}"]


def _mismatches(folder: Path, meta: Mapping[str, Any]) -> list[str]:
    """Whether the content, and the scene of a simulated sample, belong to the id; a sentence for each that does not."""
    problems, content = [], meta["content"]
    if sample_id(meta["producer"], content) != meta["id"]:
        problems.append(f"content is not that of {meta['id']}")
    if meta["producer"] == FRACSIM:
        scene = schema.load_scene(folder / schema.SCENE)
        if scene_content(scene, content) != canonical(content):
            problems.append(f"{schema.SCENE} is not the scene of {meta['id']}")
    return problems


def _differences(written: Mapping[str, Any], there: Mapping[str, Any]) -> list[str]:
    """Files lost, added or changed."""
    lost = [f"{name} is missing" for name in written if name not in there]
    added = [f"{name} is not part of the sample" for name in there if name not in written]
    changed = [f"{name} has changed" for name in written if name in there and written[name] != there[name]]
    return lost + added + changed


def _recover(folder: Path, meta: dict[str, Any]) -> None:
    """Fill in the frames of an unfinished sample from its journal; its last line may be cut off."""
    lines = []
    for line in (folder / schema.JOURNAL).read_text(encoding="utf-8").splitlines():
        try:
            lines.append(json.loads(line))
        except ValueError:
            break
    meta["frames"] = len(lines)
    if meta["schema"] < 3:
        lines = [{"ranges": line, "outliers": dict.fromkeys(meta["maps"], ())} for line in lines]
    meta["ranges"] = {name: [line["ranges"][name] for line in lines] for name in meta["maps"]}
    meta["outliers"] = {name: [at for line in lines for at in line["outliers"][name]] for name in meta["maps"]}


def _readable(folder: Path, meta: dict[str, Any]) -> int:
    """Frames that are whole in every video of a damaged or unfinished sample."""
    videos = [schema.RGB] * meta["rgb"] + [schema.ALPHA] * meta["alpha"] + [schema.map_file(m) for m in meta["maps"]]
    return min([int(meta["frames"]), *(count(folder / name) for name in videos)])
