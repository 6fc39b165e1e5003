"""A packed copy of a data set, for fast reading: blosc2 chunks a frame each, reduced in size if wanted.

It is a data set of its own: `fracsim.dataset.open` reads it, and physical values are those of the original bit for bit
unless they were reduced. A clip is there as a whole or not at all, so that a copy that was interrupted is continued.
"""

import os
import shutil
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from fracsim.dataset import folders
from fracsim.dataset.choice import Summary, chosen
from fracsim.dataset.progress import Progress, silent
from fracsim.dataset.reader import Clip, Clips
from fracsim.records import Array
from fracsim.sample import Sample, chunked, schema
from fracsim.sample import verify as differences
from fracsim.sample.folder import is_whole
from fracsim.sample.identity import digest
from fracsim.sample.quantise import encode

KEPT = (schema.HISTORY,)
"""Files that are copied as they are, beside the document."""


@dataclass(frozen=True)
class Job:
    """What a packed copy holds."""

    fields: tuple[str, ...]
    """Of rgb, alpha, tracks and the maps."""
    width: int | None = None
    """Width of the pictures [px]; None = as they are."""


def pack(clips: Clips, out: Path, only: Sequence[str] = (), width: int | None = None, processes: int = 1,
         progress: Progress = silent) -> Summary:  # fmt: skip
    """Write the packed copy of `clips` into the folder `out`, by several processes; what is there already stays.

    Raises ValueError when a clip lacks what `only` asks for, or cannot be reduced to `width` [px].
    """
    job = Job(chosen(clips, only), width)
    out.mkdir(parents=True, exist_ok=True)
    for name in folders.unfinished(out):  # of a process that was killed
        shutil.rmtree(out / name)
    missing = [clip for clip in clips if not _is_packed(clip, out, job)]
    work = partial(_pack, out=out, job=job)
    if processes > 1:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            list(progress(pool.map(work, missing), len(missing), "packing clips"))
    else:
        list(progress(map(work, missing), len(missing), "packing clips"))
    return Summary(len(missing), len(clips) - len(missing), sum(_size(out / clip.row["id"]) for clip in clips))


def verify(clips: Clips, out: Path, progress: Progress = silent) -> list[str]:
    """What is wrong with the packed copy of `clips` in `out`, a sentence each: all its files are hashed again."""
    problems = []
    for clip in progress(clips, len(clips), "hashing clips"):
        path = out / clip.row["id"]
        problems += [f"{path.name}: {problem}" for problem in differences(path)]
        if is_whole(path) and schema.read_meta(path).get("packed", {}).get("source") != _source(clip):
            problems.append(f"{path.name}: the sample has changed since it was packed")
    return problems


def _is_packed(clip: Clip, out: Path, job: Job) -> bool:
    """Whether `out` holds this clip as it is now, packed in this way."""
    path = out / clip.row["id"]
    return is_whole(path) and schema.read_meta(path).get("packed") == _how(clip, job)


def _how(clip: Clip, job: Job) -> dict[str, Any]:
    return {"source": _source(clip), "fields": list(job.fields), "width": job.width}


def _source(clip: Clip) -> str:
    return digest(clip.folder / clip.row["path"] / schema.META)


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())


def _pack(clip: Clip, out: Path, job: Job) -> None:
    """Write one clip under a temporary name, then rename it."""
    sample, target = clip.sample, out / clip.row["id"]
    new = out / f"{target.name}.partial-{os.getpid()}"
    try:
        (new / "maps").mkdir(parents=True)
        meta = _reduced(sample.meta, job) | {"storage": chunked.STORAGE, "packed": _how(clip, job)}
        for what in job.fields:
            _write(sample, what, new, meta)
        for name in (*KEPT, meta["document"]):
            if (sample.path / name).is_file():
                shutil.copyfile(sample.path / name, new / name)
        meta["files"] = schema.inventory(new)
        schema.write_meta(new, meta)
        if target.exists():  # an older copy, of a sample or of a way of packing that has changed
            shutil.rmtree(target)
        new.rename(target)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def _reduced(meta: Mapping[str, Any], job: Job) -> dict[str, Any]:
    """meta.json of a packed clip: its size, its camera, and what it holds."""
    out, maps = dict(meta), [name for name in meta["maps"] if name in job.fields]
    out |= {name: meta[name] and name in job.fields for name in ("rgb", "alpha")}
    out |= {name: {m: meta[name][m] for m in maps} for name in ("maps", "ranges", "outliers")}
    if job.width is None:
        return out
    width, height = meta["size"]
    ratio = job.width / width
    if not 0 < ratio <= 1 or height * job.width % width:
        raise ValueError(f"--size {job.width} does not fit clip {meta['id']} of {width} x {height} px: give a width up "
                         f"to {width} px that makes the height a whole number of pixels.")  # fmt: skip
    out["size"] = [job.width, height * job.width // width]
    if "view" in meta:
        scaled = {name: meta["view"][name] * ratio for name in ("fx", "fy", "cx", "cy")}
        out["view"] = {**meta["view"], **scaled, "width": job.width, "height": out["size"][1]}
    return out


def _write(sample: Sample, what: str, folder: Path, meta: dict[str, Any]) -> None:
    """Write "rgb", "alpha", a map or the tracks, and put new ranges and outliers of a map into `meta`."""
    width, height = meta["size"]
    same = meta["size"] == sample.meta["size"]
    if what == "tracks":
        scale = np.float32(width / sample.meta["size"][0])
        xy, visible, particles = sample.tracks
        np.savez_compressed(folder / schema.TRACKS, xy=xy * scale, visible=visible, particles=particles)
        return
    frames, about = sample.stored(what), {}
    if what in meta["maps"]:
        if not same:
            # A pixel holds the quantity times its coverage: both are averaged, and their quotient stays the quantity.
            planes = np.moveaxis(sample.read(what), -1, 1)
            coded = [encode(np.stack([shrink(plane, height, width) for plane in frame])) for frame in planes]
            frames = np.stack([c.codes for c in coded])
            meta["ranges"][what] = [[list(span) for span in c.ranges] for c in coded]
            meta["outliers"][what] = [[k, *at] for k, c in enumerate(coded) for at in c.outliers]
        about = {"unit": meta["maps"][what]["unit"], **{m: meta[m][what] for m in ("ranges", "outliers")}}
    elif not same:
        frames = np.stack([np.rint(shrink(frame, height, width)).astype(frame.dtype) for frame in frames])
    chunked.write(folder / chunked.file(what), frames, about)


def shrink(picture: Array, height: int, width: int) -> Array:
    """A picture [H, W] or [H, W, C] averaged over the area of each new pixel, [height, width(, C)] float32.

    A pixel counts by the part of it that lies in the new one; zeros stay exactly zero.
    """
    if picture.ndim == 3:
        return np.stack([shrink(channel, height, width) for channel in np.moveaxis(picture, -1, 0)], -1)
    rows, columns = (_shares(old, new) for old, new in zip(picture.shape, (height, width), strict=True))
    return np.asarray((columns @ (rows @ picture).T).T, np.float32)


def _shares(old: int, new: int) -> csr_array:
    """The share of each old pixel in each new one along an axis, (new, old); each row sums to 1."""
    edges = np.arange(new + 1) * (old / new)
    cells = np.arange(old)
    overlap = np.minimum(edges[1:, None], cells + 1) - np.maximum(edges[:-1, None], cells)
    return csr_array(np.maximum(overlap, 0) * (new / old))
