"""How fast clips are read: the archive beside PyAV on the same files, and a packed copy; and what each takes on disk.

A worker reads stretches of 17 frames, colour and all maps, from clips and frames at random, the same for all readers.
The readers take turns, so that only their ratios matter on a machine that does other things, too.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

import fracsim.dataset
from fracsim.bench.record import Row, median
from fracsim.bench.worker import Answer, Worker, serve
from fracsim.dataset import pack
from fracsim.dataset.reader import Clip, Clips
from fracsim.sample import schema
from fracsim.sample.video import DECODER, FPS

LENGTH, READS, ROUNDS = 17, 8, 7
"""Frames a read, reads a measurement, and measurements a reader."""
SLOWER, PACKED, MEGABYTES = 1.2, 20.0, 25.0
"""Most times PyAV's own time, least clips/s of the packed copy on two cores, most MB a clip."""
SCENES = (("asset=bread",), ("asset=duck", "material=rubber", "fracture=rubber"))
WHAT = "17 frames, RGB and four maps"
READERS = {
    "pyav": "PyAV alone, codes as they are stored",
    "archive": "archive, through PyAV",
    "ffmpeg": "archive, through ffmpeg (without PyAV)",
    "packed": "packed copy",
}


def by_pyav(clip: Clip, start: int) -> None:
    """Decode the files as the pages of PyAV show: the decoder's own time."""
    import av

    files = {schema.RGB: "rgb24"} | {schema.map_file(name): "gray16le" for name in clip.sample.meta["maps"]}
    for file, pixels in files.items():
        frames = []
        with av.open(str(clip.sample.path / file)) as container:
            stream = container.streams.video[0]
            stream.thread_type = "SLICE"
            container.seek(round(start / FPS / float(stream.time_base or 1)), stream=stream)
            for frame in container.decode(stream):
                if round(frame.time * FPS) >= start:
                    frames.append(frame.to_ndarray(format=pixels))
                if len(frames) == LENGTH:
                    break


def by_us(clip: Clip, start: int) -> None:
    """Read the same in physical units."""
    for what in ("rgb", *clip.sample.meta["maps"]):
        clip.read(what, start, min(start + LENGTH, clip.row["frames"]))


def measure(clips: list[Clip], read: Callable[[Clip, int], None], rng: np.random.Generator) -> Answer:
    """Read READS stretches; seconds of the clock and of the processors for all of them, those of ffmpeg included."""
    begin, spent = time.perf_counter(), _busy()
    for _ in range(READS):
        clip = clips[rng.integers(len(clips))]
        read(clip, int(rng.integers(max(clip.row["frames"] - LENGTH, 0) + 1)))
    return {"seconds": time.perf_counter() - begin, "busy": _busy() - spent}


def _busy() -> float:
    """Seconds of the processors so far: nanoseconds are counted here, hundredths of a second in what was started."""
    ended = os.times()
    return time.process_time() + ended.children_user + ended.children_system


def work(words: list[str] | None = None) -> None:
    """A worker: `reading READER FOLDER SEED`."""
    parser = argparse.ArgumentParser()
    parser.add_argument("reader", choices=list(READERS))
    parser.add_argument("folder")
    parser.add_argument("seed", type=int)
    given = parser.parse_args(words)
    clips = list(fracsim.dataset.open(given.folder, suspect=True))
    read = by_pyav if given.reader == "pyav" else by_us
    read(clips[0], 0)  # what is imported or mapped at first use
    serve(partial(measure, clips, read, np.random.default_rng(given.seed)))


@dataclass
class Speed:
    """Of one reader, one entry a round."""

    seconds: list[float] = field(default_factory=list)
    """Of the clock, for a read by one process alone."""
    busy: list[float] = field(default_factory=list)
    """Of the processors, for the same: what else runs on the machine adds little to them."""
    rate: list[float] = field(default_factory=list)
    """Reads a second of two processes side by side."""


def turns(folders: dict[str, Path], rounds: int) -> dict[str, Speed]:
    """The speed of each reader; they take turns in each round."""
    found = {name: Speed() for name in READERS}
    with ExitStack() as stack:
        workers = {name: [stack.enter_context(_worker(name, folders, seed)) for seed in (0, 1)] for name in READERS}
        for _ in range(rounds):
            for name, (first, _) in workers.items():
                answer = first.measure()
                found[name].seconds.append(answer["seconds"] / READS)
                found[name].busy.append(answer["busy"] / READS)
            for name, pair in workers.items():
                for worker in pair:
                    worker.go()
                found[name].rate.append(2 * READS / max([worker.answer()["seconds"] for worker in pair]))
    return found


def _worker(name: str, folders: dict[str, Path], seed: int) -> Worker:
    decoder = {DECODER: "ffmpeg"} if name == "ffmpeg" else {}
    return Worker("reading", name, folders["packed" if name == "packed" else "archive"], seed, env=os.environ | decoder)


def rows(clips: Clips, copy: Path, rounds: int) -> Iterator[Row]:
    """Speeds and sizes of the archive and of its packed copy."""
    begin = time.perf_counter()
    done = pack.pack(clips, copy)
    yield Row("packing", "a clip", (time.perf_counter() - begin) / len(clips), "s")
    found = turns({"archive": clips.folder, "packed": copy}, rounds)
    for name, speed in found.items():
        yield median(WHAT, READERS[name], speed.seconds, "s")
    for name in ("archive", "ffmpeg", "packed"):  # within a round, for the machine may slow down
        for what, kind in (("seconds", "time"), ("busy", "processor time")):
            ratios = [a / b for a, b in zip(getattr(found[name], what), getattr(found["pyav"], what), strict=True)]
            yield median(WHAT, f"{READERS[name]} / PyAV alone, {kind}", ratios, "times",
                         most=SLOWER if name == "archive" else None)  # fmt: skip
    for name, speed in found.items():
        alone, least = [1 / s for s in speed.seconds], PACKED if name == "packed" else None
        yield Row(
            f"speed: {WHAT}", f"{READERS[name]}, one process", statistics.median(alone), "clips/s", best=max(alone)
        )
        yield Row(f"speed: {WHAT}", f"{READERS[name]}, two processes", statistics.median(speed.rate), "clips/s",
                  least=least, best=max(speed.rate))  # fmt: skip
        yield Row(f"speed: {WHAT}", f"{READERS[name]}, two cores of their own, from the processor time",
                  2 / statistics.median(speed.busy), "clips/s", least=least)  # fmt: skip
    for clip in clips:
        yield from sizes(clip)
    yield Row("bytes", "packed copy, mean of the clips", done.bytes / len(clips) / 1e6, "MB")


def sizes(clip: Clip) -> Iterator[Row]:
    """What a clip takes in the archive, by kind of file."""
    files = {name: entry["bytes"] / 1e6 for name, entry in clip.sample.meta["files"].items()}
    name = f"bytes: {clip.row['object']}, {clip.row['frames']} frames"
    yield Row(name, "all files", sum(files.values()), "MB", most=MEGABYTES)
    for file in sorted(files, key=lambda file: -files[file]):
        if files[file] >= 0.1:
            yield Row(name, file, files[file], "MB")


def record(folder: Path, quick: bool) -> Clips:
    """The clips, made by the command; raises RuntimeError with what it said when it fails."""
    for scene in SCENES:
        small = ("quality=preview", "solver.cells=40", "capture.frames=20", "camera.width=64", "camera.height=64")
        command = [sys.executable, "-m", "fracsim", f"output.folder={folder}", *scene, *(small if quick else ())]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode:
            raise RuntimeError(f"{' '.join(command)} ended with status {done.returncode}:\n{done.stdout}")
    return fracsim.dataset.open(folder, suspect=True)


def study(out: Path, quick: bool) -> Iterator[Row]:
    """Two clips of the default quality, 100 frames of 512 x 512 with all maps, or tiny ones."""
    with tempfile.TemporaryDirectory() as folder:
        clips = record(Path(folder) / "archive", quick)
        yield from rows(clips, Path(folder) / "packed", 2 if quick else ROUNDS)


if __name__ == "__main__":
    work()
