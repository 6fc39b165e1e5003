"""Writes a sample frame by frame; whatever happens, what was written stays readable."""

import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import numpy as np

from fracsim.records import Array
from fracsim.sample import schema
from fracsim.sample.folder import claim, keep_incomplete, publish
from fracsim.sample.header import Header
from fracsim.sample.identity import canonical
from fracsim.sample.provenance import provenance
from fracsim.sample.quantise import LEVELS, Coded, encode
from fracsim.sample.strip import Strip, reduction
from fracsim.sample.video import Encoder
from fracsim.scene.vocab import Output

Tracks = tuple[Array, Array]
_RESERVE = ".reserve"
"""Holds the space of what comes last, so that it still fits when the frames have filled the disk."""


class Writer:
    """A sample being written; a context manager that keeps it as incomplete when an exception passes.

    Raises ValueError naming output.folder when a sample of this size cannot be written there, or is there already and
    output.overwrite is off.
    """

    def __init__(self, header: Header, output: Output) -> None:
        self.id = header.id
        self.frames = 0
        self._header, self._output = header, output
        self._particles: Array | None = None
        self._ranges: dict[str, list[list[tuple[float, float]]]] = {name: [] for name in header.maps}
        self._outliers: dict[str, list[tuple[int, int, int, int, float]]] = {name: [] for name in header.maps}
        self._largest = dict.fromkeys(header.maps, 0.0)
        self._scale = dict.fromkeys(header.maps, 0.0)
        self._tracks: list[Tracks] = []
        self._encoders: dict[str, Encoder] = {}
        self._strip: Strip | None = None
        self._journal: TextIO | None = None
        self._meta = _first_meta(header)
        self.folder = claim(output, self.id, self._estimate())
        """Where the sample lies; other files put here before `finish` become part of it."""
        self._open = True
        try:
            self._begin()
        except OSError as error:
            self._give_up(error)
            raise self._explained(error) from error
        except BaseException as error:
            self._give_up(error)
            raise

    def _estimate(self) -> int:
        """Bytes that the sample and its scratch file may need; the videos of textured objects took a third or less."""
        h = self._header
        channels = sum(info.channels for info in h.maps.values())
        per_pixel = 0.5 * h.rgb + 0.4 * (channels + h.alpha)
        if h.strip and h.pictures:
            per_pixel += (3 * h.rgb + h.alpha + 2 * channels) / reduction(h.width) ** 2
        return int(h.frames * h.width * h.height * per_pixel) + self._late_bytes()

    def _late_bytes(self) -> int:
        return 9 * self._header.frames * self._header.tracks + (1 << 20)

    def _begin(self) -> None:
        header = self._header
        w, h = header.width, header.height
        schema.write_meta(self.folder, self._meta)
        schema.save_document(header.document, self.folder / header.document_file)
        (self.folder / _RESERVE).write_bytes(bytes(self._late_bytes()))
        self._journal = (self.folder / schema.JOURNAL).open("w", encoding="utf-8")
        if header.rgb:
            self._encoders["rgb"] = Encoder(self.folder / schema.RGB, w, h, "rgb")
        if header.alpha:
            self._encoders["alpha"] = Encoder(self.folder / schema.ALPHA, w, h, "gray16")
        if header.maps:
            (self.folder / "maps").mkdir()
        for name, info in header.maps.items():
            self._encoders[name] = Encoder(self.folder / schema.map_file(name), w, h * info.channels, "gray16")
        if header.strip and header.pictures:
            self._strip = Strip(self.folder, header)

    def track(self, particles: Array) -> None:
        """Name the particles, (M,) indices, whose tracks `add` will get."""
        self._particles = particles

    def add(
        self,
        index: int,
        rgb: Array | None,
        alpha: Array | None,
        maps: Mapping[str, Array],
        tracks: Tracks | None = None,
    ) -> None:
        """Append frame `index`: rgb uint8 [H, W, 3], alpha [H, W], maps [H, W, C], tracks xy [M, 2] and visible [M].

        Maps are composited on zero: the quantity times its coverage alpha.

        Raises ValueError when a map is not finite, OSError naming output.folder when the disk is full.
        """
        self._check(index, rgb, alpha, maps)
        planes = {name: np.ascontiguousarray(np.moveaxis(maps[name], -1, 0), np.float32) for name in self._header.maps}
        coded = {name: self._coded(name, planes[name]) for name in self._header.maps}
        for name, c in coded.items():
            self._see(name, planes[name], c)
        ranges = {name: c.ranges for name, c in coded.items()}
        outliers = {name: [(index, *at) for at in c.outliers] for name, c in coded.items()}
        try:
            if rgb is not None:
                self._encoders["rgb"].write(rgb)
            if alpha is not None:
                self._encoders["alpha"].write(np.rint(np.clip(alpha, 0, 1) * LEVELS).astype(np.uint16))
            for name, c in coded.items():
                self._encoders[name].write(c.codes)
            if self._strip is not None:
                self._strip.add(rgb, alpha, planes)
            # Last, so that a frame counts only when all of it has been handed over.
            assert self._journal is not None
            self._journal.write(json.dumps({"ranges": ranges, "outliers": outliers}) + "\n")
            self._journal.flush()
        except OSError as error:
            raise self._explained(error) from error
        for name in ranges:
            self._ranges[name].append(ranges[name])
            self._outliers[name].extend(outliers[name])
        if tracks is not None:
            self._tracks.append((np.array(tracks[0], np.float32), np.array(tracks[1], bool)))
        self.frames += 1

    def _check(self, index: int, rgb: Array | None, alpha: Array | None, maps: Mapping[str, Array]) -> None:
        """Assert that a frame has what the header announced."""
        header, size = self._header, (self._header.height, self._header.width)
        assert index == self.frames, f"frame {index} came after {self.frames} frames"
        assert set(maps) == set(header.maps), f"maps {sorted(maps)} came instead of {sorted(header.maps)}"
        assert (rgb is not None, alpha is not None) == (header.rgb, header.alpha)
        assert rgb is None or (rgb.shape == (*size, 3) and rgb.dtype == np.uint8)
        assert alpha is None or alpha.shape == size
        for name, info in header.maps.items():
            assert maps[name].shape == (*size, info.channels), (name, maps[name].shape)

    def _see(self, name: str, planes: Array, coded: Coded) -> None:
        """Take account of the largest value of a map [C, H, W], with outliers and without."""
        square = (planes**2).sum(axis=0)
        self._largest[name] = max(self._largest[name], float(np.sqrt(square.max())))
        for _, row, column, _ in coded.outliers:
            square[row, column] = 0
        self._scale[name] = max(self._scale[name], float(np.sqrt(square.max())))

    def _coded(self, name: str, planes: Array) -> Coded:
        """A map [C, H, W] as codes, ranges and outliers."""
        try:
            return encode(planes)
        except ValueError as error:
            raise ValueError(f"map {name} of frame {self.frames}: {error}.") from None

    def finish(
        self,
        report: Mapping[str, Any] | None = None,
        history: Mapping[str, Sequence[float]] | None = None,
        seconds: Mapping[str, float] | None = None,
        reason: str = "",
    ) -> Path:
        """Close the sample and return where it lies: `<id>`, or `<id>.incomplete` if there is a `reason` for that.

        `report` and `seconds` go to meta.json, `history` to history.npz and report.png. Raises OSError naming
        output.folder when the disk is full.
        """
        missing = self._header.frames - self.frames
        assert reason or not missing, f"{missing} frames are missing: add them, or give the reason"
        try:
            failure = self._close_encoders()
            if failure and not reason:  # else the reader finds out which frames are whole
                raise failure
            self._save_tracks()
            self._save_summaries(report or {}, history or {})
            self._seal(reason, report or {}, seconds or {})
        except OSError as error:
            raise self._explained(error) from error
        self._open = False
        if reason:
            self.folder = keep_incomplete(self.folder, self.id)
        else:
            self.folder = publish(self.folder, self.id, self._output.overwrite)
        return self.folder

    def _close_encoders(self) -> OSError | None:
        """Finish all videos and return the first failure; the reserve is given up for what follows."""
        failures: list[OSError] = []
        for encoder in self._encoders.values():
            try:
                encoder.close()
            except OSError as error:
                failures.append(error)
        (self.folder / _RESERVE).unlink(missing_ok=True)
        return failures[0] if failures else None

    def _save_tracks(self) -> None:
        if self._tracks:
            xy, visible = (np.stack(parts) for parts in zip(*self._tracks, strict=True))
            particles = np.arange(xy.shape[1]) if self._particles is None else self._particles
            assert len(particles) == xy.shape[1], f"{len(particles)} indices for {xy.shape[1]} tracked particles"
            np.savez_compressed(self.folder / schema.TRACKS, xy=xy, visible=visible,
                                particles=np.asarray(particles, np.int64))  # fmt: skip

    def _save_summaries(self, report: Mapping[str, Any], history: Mapping[str, Sequence[float]]) -> None:
        if history:
            curves: dict[str, Any] = {name: np.asarray(curve) for name, curve in history.items()}
            np.savez_compressed(self.folder / schema.HISTORY, **curves)
        if history and self._header.report:
            from fracsim.sample.curves import plot  # here, because matplotlib takes long to load

            marks = self._header.thresholds
            if marks:  # fracture.length rescales the second one for the cells of the run
                marks = marks[0], report.get("lambda_crit", marks[1])
            plot(history, report, self.folder / schema.REPORT, marks)
        if self._strip is not None and self.frames:
            self._strip.encode(self.folder / schema.STRIP)

    def _seal(self, reason: str, report: Mapping[str, Any], seconds: Mapping[str, float]) -> None:
        """Write the last meta.json; nothing in the folder changes after it."""
        self._close_scratch()
        for name, entry in self._meta["maps"].items():
            entry["largest"] = self._largest[name]
            entry["scale"] = self._header.maps[name].scale or self._scale[name] or 1.0  # a divisor: never 0
        self._meta |= {
            "complete": not reason, "reason": reason, "frames": self.frames, "report": report, "seconds": seconds,
            "files": schema.inventory(self.folder), "ranges": self._ranges,
            "outliers": self._outliers,
        }  # fmt: skip
        schema.write_meta(self.folder, self._meta)
        (self.folder / schema.JOURNAL).unlink(missing_ok=True)

    def _close_scratch(self) -> None:
        if self._strip is not None:
            self._strip.close()
        if self._journal is not None:
            self._journal.close()

    def _give_up(self, error: BaseException | None) -> None:
        """Keep the frames there are as incomplete, on a disk that may be full; without any, leave nothing."""
        self._open = False
        reason = f"{type(error).__name__}: {error}" if error else "its writer was left before the end"
        with suppress(OSError):
            self._close_scratch()  # first, for its space may let the encoders end well
        with suppress(OSError):
            self._close_encoders()
        if self.frames:
            with suppress(OSError):
                self._save_tracks()
            with suppress(OSError):
                self._seal(reason, {}, {})
            self.folder = keep_incomplete(self.folder, self.id)
        else:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _explained(self, error: OSError) -> OSError:
        """The error with the field, the space there is and the way out."""
        free = shutil.disk_usage(self.folder.parent).free / 1e6
        kept = f" What was written is kept as {self.id}.incomplete." if self.frames else ""
        return OSError(
            f"output.folder={self._output.folder}: writing failed after {self.frames} frames ({error}); "
            f"{free:.0f} MB are free there. Free some space or set output.folder to another disk, then run again.{kept}"
        )

    def __enter__(self) -> "Writer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self._give_up(error)


def _first_meta(header: Header) -> dict[str, Any]:
    """meta.json of a sample without frames."""
    meta = {
        "schema": schema.VERSION, "producer": header.producer, "id": header.id, "complete": False,
        "reason": "it is still being written, or its process was killed",
        "frames": 0, "fps": header.fps, "size": [header.width, header.height],
        "rgb": header.rgb, "alpha": header.alpha, "maps": {name: asdict(info) for name, info in header.maps.items()},
        "document": header.document_file, "content": canonical(header.content),
        "provenance": provenance(header.producer, header.version, header.packages),
        "report": {}, "seconds": {}, "files": {}, "ranges": {}, "outliers": {},
    }  # fmt: skip
    clash = sorted(set(meta) & set(header.about))
    assert not clash, f"about={clash} are entries of the writer's own"
    return {**meta, **header.about}
