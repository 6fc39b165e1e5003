"""Writes a sample frame by frame; whatever happens, what was written stays readable."""

import json
import shutil
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, TextIO

import numpy as np

from fracsim import registry
from fracsim.records import Array
from fracsim.sample import schema
from fracsim.sample.folder import claim, find, publish, shelve
from fracsim.sample.provenance import provenance
from fracsim.sample.quantise import LEVELS, quantise
from fracsim.sample.strip import Panel, Strip, reduction
from fracsim.sample.video import Encoder
from fracsim.scene.vocab import Scene

__all__ = ["Writer", "find"]

Tracks = tuple[Array, Array]
_RESERVE = ".reserve"
"""Holds the space of what comes last, so that it still fits when the frames have filled the disk."""


class Writer:
    """A sample being written; a context manager that keeps it as incomplete when an exception passes.

    `view_size` is (width, height) [px], `view` describes the camera, `maps` are names of fracsim.maps, `rgb` tells
    whether colour will come. Raises ValueError naming output.folder when a sample of this size cannot be written there.
    """

    def __init__(
        self,
        scene: Scene,
        view_size: tuple[int, int],
        view: Mapping[str, Any],
        maps: Sequence[str],
        rgb: bool,
    ) -> None:
        asset_sha256 = schema.asset_digest(scene)
        self.id = schema.sample_id(scene, asset_sha256)
        self.frames = 0
        self._scene, self._rgb = scene, rgb
        self._particles: Array | None = None
        self._width, self._height = view_size
        self._modules = {name: registry.load("fracsim.maps", name, "capture.maps") for name in maps}
        self._ranges: dict[str, list[list[tuple[float, float]]]] = {name: [] for name in maps}
        self._largest = dict.fromkeys(maps, 0.0)
        self._tracks: list[Tracks] = []
        self._encoders: dict[str, Encoder] = {}
        self._strip: Strip | None = None
        self._journal: TextIO | None = None
        self._meta: dict[str, Any] = {
            "schema": schema.VERSION, "id": self.id, "complete": False,
            "reason": "it is still being written, or its process was killed",
            "frames": 0, "fps": scene.capture.fps, "size": list(view_size), "rgb": rgb,
            "maps": {name: _about(module) for name, module in self._modules.items()},
            "asset_sha256": asset_sha256, "view": view, "backend": asdict(scene.backend),
            "provenance": provenance(), "report": {}, "seconds": {}, "files": {}, "ranges": {},
        }  # fmt: skip
        self.folder = claim(scene, self.id, self._estimate())
        """Where the sample lies while it is written; other files put here become part of it."""
        self._open = True
        try:
            self._begin()
        except OSError as error:
            self._give_up(error)
            raise self._explained(error) from error
        except BaseException as error:
            self._give_up(error)
            raise

    @property
    def _pictures(self) -> bool:
        return bool(self._rgb or self._modules)

    def _estimate(self) -> int:
        """Bytes that the sample and its scratch file may need; the videos of textured objects took a third or less."""
        channels = sum(module.CHANNELS for module in self._modules.values())
        per_pixel = 0.5 * self._rgb + 0.4 * (channels + self._pictures)
        if self._scene.capture.strip:
            per_pixel += (3 * self._rgb + self._pictures + 2 * channels) / reduction(self._width) ** 2
        return int(self._scene.capture.frames * self._width * self._height * per_pixel) + self._late_bytes()

    def _late_bytes(self) -> int:
        return 9 * self._scene.capture.frames * self._scene.capture.tracks + (1 << 20)

    def _begin(self) -> None:
        w, h = self._width, self._height
        schema.write_meta(self.folder, self._meta)
        schema.save_scene(self._scene, self.folder / schema.SCENE)
        (self.folder / _RESERVE).write_bytes(bytes(self._late_bytes()))
        self._journal = (self.folder / schema.JOURNAL).open("w", encoding="utf-8")
        if self._rgb:
            self._encoders["rgb"] = Encoder(self.folder / schema.RGB, w, h, "rgb")
        if self._pictures:
            self._encoders["alpha"] = Encoder(self.folder / schema.ALPHA, w, h, "gray16")
        if self._modules:
            (self.folder / "maps").mkdir()
        for name, module in self._modules.items():
            path = self.folder / schema.map_file(name)
            self._encoders[name] = Encoder(path, w, h * module.CHANNELS, "gray16")
        if self._pictures and self._scene.capture.strip:
            panels = [Panel.of(name, module) for name, module in self._modules.items()]
            self._strip = Strip(self.folder, w, h, self._rgb, panels, self._scene.capture.fps)

    def track(self, particles: Array) -> None:
        """Name the particles, (M,) indices, whose tracks `add` will get."""
        self._particles = particles

    def add(
        self,
        index: int,
        rgb: Array | None,
        alpha: Array | None,
        maps: Mapping[str, Array],
        tracks: Tracks | None,
    ) -> None:
        """Append frame `index`: rgb uint8 [H, W, 3], alpha [H, W], maps [H, W, C], tracks xy [M, 2] and visible [M].

        Raises ValueError when a map is not finite, OSError naming output.folder when the disk is full.
        """
        assert index == self.frames, f"frame {index} came after {self.frames} frames"
        assert set(maps) == set(self._modules), f"maps {sorted(maps)} came instead of {sorted(self._modules)}"
        assert (rgb is not None, alpha is not None) == (self._rgb, self._pictures)
        assert rgb is None or (rgb.shape == (self._height, self._width, 3) and rgb.dtype == np.uint8)
        planes = {name: self._planes(name, maps[name]) for name in self._modules}
        coded = {name: self._coded(name, planes[name]) for name in self._modules}
        try:
            if rgb is not None:
                self._encoders["rgb"].write(rgb)
            if alpha is not None:
                self._encoders["alpha"].write(np.rint(np.clip(alpha, 0, 1) * LEVELS).astype(np.uint16))
            for name, (codes, _) in coded.items():
                self._encoders[name].write(codes)
            if self._strip is not None and alpha is not None:
                self._strip.add(rgb, alpha, planes)
            # Last, so that a frame counts only when all of it has been handed over.
            assert self._journal is not None
            self._journal.write(json.dumps({name: ranges for name, (_, ranges) in coded.items()}) + "\n")
            self._journal.flush()
        except OSError as error:
            raise self._explained(error) from error
        for name, (_, ranges) in coded.items():
            self._ranges[name].append(ranges)
        if tracks is not None:
            self._tracks.append((np.array(tracks[0], np.float32), np.array(tracks[1], bool)))
        self.frames += 1

    def _planes(self, name: str, values: Array) -> Array:
        """The channels of a map one after the other in memory, [C, H, W] float32."""
        assert values.shape == (self._height, self._width, self._modules[name].CHANNELS), (name, values.shape)
        planes = np.ascontiguousarray(np.moveaxis(values, -1, 0), np.float32)
        self._largest[name] = max(self._largest[name], float(np.sqrt((planes**2).sum(axis=0).max())))
        return planes

    def _coded(self, name: str, planes: Array) -> tuple[Array, list[tuple[float, float]]]:
        """A map [C, H, W] as codes [C H, W] and the range of each channel."""
        try:
            pairs = [quantise(plane) for plane in planes]
        except ValueError as error:
            raise ValueError(f"map {name} of frame {self.frames}: {error}.") from None
        return np.concatenate([codes for codes, _ in pairs]), [span for _, span in pairs]

    def finish(
        self,
        report: Mapping[str, Any],
        history: Mapping[str, Sequence[float]],
        seconds: Mapping[str, float],
        complete: bool,
        reason: str = "",
    ) -> Path:
        """Close the sample, name it `<id>`, or `<id>.incomplete` for a `reason`, and return where it is.

        Raises OSError naming output.folder when the disk is full.
        """
        assert not complete or self.frames == self._scene.capture.frames, f"only {self.frames} frames were added"
        try:
            failure = self._close_encoders()
            if failure and complete:  # else the reader finds out which frames are whole
                raise failure
            self._save_tracks()
            self._save_summaries(report, history)
            self._seal(complete, "" if complete else reason or "it was stopped early", report, seconds)
        except OSError as error:
            raise self._explained(error) from error
        self._open = False
        return publish(self.folder, self.id, self._scene.output.overwrite) if complete else shelve(self.folder, self.id)

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
        if history and self._scene.capture.report:
            from fracsim.sample.curves import plot  # here, because matplotlib takes long to load

            fracture = self._scene.fracture
            crit = report.get("lambda_crit", fracture.crit)  # not that of the scene where fracture.length changed it
            plot(history, report, self.folder / schema.REPORT, (fracture.onset, crit))
        if self._strip is not None and self.frames:
            self._strip.encode(self.folder / schema.STRIP)

    def _seal(self, complete: bool, reason: str, report: Mapping[str, Any], seconds: Mapping[str, float]) -> None:
        """Write the last meta.json; nothing in the folder changes after it."""
        self._close_scratch()
        for name, about in self._meta["maps"].items():
            about["largest"] = self._largest[name]
            about["scale"] = self._modules[name].SCALE or self._largest[name] or 1.0  # never 0, one divides by it
        self._meta |= {
            "complete": complete, "reason": reason, "frames": self.frames, "report": report, "seconds": seconds,
            "files": schema.inventory(self.folder), "ranges": self._ranges,
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
                self._seal(False, reason, {}, {})
            shelve(self.folder, self.id)
        else:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _explained(self, error: OSError) -> OSError:
        free = shutil.disk_usage(self.folder.parent).free / 1e6
        kept = f" What was written is kept as {self.id}.incomplete." if self.frames else ""
        return OSError(
            f"output.folder={self._scene.output.folder}: writing failed after {self.frames} frames ({error}); "
            f"{free:.0f} MB are free there. Free some space or set output.folder to another disk, then run again.{kept}"
        )

    def __enter__(self) -> "Writer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self._give_up(error)


def _about(module: ModuleType) -> dict[str, Any]:
    return {"label": module.LABEL, "unit": module.UNIT, "channels": module.CHANNELS}
