"""What is to be sampled: a picture and a pull on it, from files of a user or from the clips of a data set."""

import hashlib
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

import fracsim.dataset
from fracgen import conditioning
from fracgen.config.encode import EncodeConfig
from fracgen.config.sample import ALL, SampleConfig
from fracgen.data import pictures
from fracgen.data.choose import choose, told
from fracgen.sampling import picture
from fracgen.sampling.trained_run import TrainedRun
from fracsim.dataset import Clip, captions
from fracsim.dataset.progress import shown
from fracsim.dataset.table import FIELDS
from fracsim.records import Array
from fracsim.sample.identity import field_of
from fracsim.scene.classes import LAWS, NONE, class_of
from fracsim.scene.condition import Condition, load


@dataclass(frozen=True, eq=False)
class Request:
    """One clip to sample; F frames of h x w pixels."""

    key: str
    """Its noise belongs to it: the id of a clip, or "" for a picture of a user."""
    picture: str
    """What tells the picture from others: the hash of its pixels, or of the clip that it is of."""
    read: Callable[[], Array]
    """Gives the picture, (h, w, 3) uint8; thousands of requests hold none in memory."""
    condition: Condition
    paths: Array
    """Positions of the grips [px], (F, 2, 2)."""
    caption: str
    fields: dict[str, Any]
    """What the table of a data set lists: fields of a scene, as material.E."""
    clip: Clip | None = None
    """The simulated clip that gave picture and condition."""


def requests(cfg: SampleConfig, run: TrainedRun, maps: Sequence[str]) -> list[Request]:
    """All that a configuration asks for; raises ValueError naming the field of what cannot be sampled."""
    if bool(cfg.data) == bool(cfg.image or cfg.condition):
        raise ValueError("data, image, condition: give image=FILE and condition=FILE, or data=FOLDER of a data set.")
    if cfg.data and (cfg.mask or cfg.cutout != picture.GROUND):
        given = f"mask={cfg.mask}" if cfg.mask else f"cutout={cfg.cutout}"
        raise ValueError(f"{given} has no effect with data={cfg.data}, whose clips show the object on white: leave it "
                         "out, or give image=FILE and condition=FILE.")  # fmt: skip
    if cfg.data:
        return list(_of_data(cfg, run, maps))
    if not cfg.image or not cfg.condition:
        lacking = "condition" if cfg.image else "image"
        raise ValueError(f"{lacking}= is empty: image and condition go together; give {lacking}=FILE.")
    if cfg.scales == "truth":
        raise ValueError("scales=truth needs simulated clips, whose scale is known: set scales=unit, or give "
                         "data=FOLDER instead of image and condition.")  # fmt: skip
    return [of_file(cfg, run)]


def of_file(cfg: SampleConfig, run: TrainedRun) -> Request:
    """The request of a picture and a condition file; frames are those of the run, whatever rate the condition has."""
    frames, height, width = run.size
    seen = picture.load(cfg.image, width, height, cfg.fit, picture.cutout(cfg.image, cfg.cutout, cfg.mask))
    given = load(cfg.condition)
    moved = picture.moved(replace(given, fps=run.cache["fps"]), seen.corner, seen.size)
    axis = _axis(moved, width, height)
    name = _object(cfg.image)
    words = {"object": name, "class": moved.category, "loading_axis_deg": axis, "break_frame": None, "torn_frame": None,
             "particles": None}  # fmt: skip
    law = next(law for law, kind in LAWS.items() if kind == moved.category)
    fields = {
        "asset.name": name, "material.law": law, "material.E": moved.E, "material.nu": moved.nu,
        "fracture.onset": moved.onset, "fracture.crit": moved.crit, "loading.axis_deg": axis,
    }  # fmt: skip
    return Request(
        key="",
        picture=hashlib.sha256(repr(seen.pixels.shape).encode() + seen.pixels.tobytes()).hexdigest(),
        read=lambda: seen.pixels,
        condition=moved,
        paths=moved.paths(frames, width, height),
        caption=moved.caption or captions.prompt(words),
        fields=fields,
    )


def _of_data(cfg: SampleConfig, run: TrainedRun, maps: Sequence[str]) -> Iterator[Request]:
    """The requests of the clips of a data set."""
    clips = fracsim.dataset.open(cfg.data)
    if cfg.split != ALL:
        clips = clips.filter(split=cfg.split)
    if cfg.objects:
        clips = clips.filter(object=cfg.objects)
    if not len(clips):
        raise ValueError(f"data={cfg.data} holds no clip of split={cfg.split}"
                         f"{f' and objects=[{chr(44).join(cfg.objects)}]' if cfg.objects else ''}: ask for another "
                         "split, as split=all.")  # fmt: skip
    encoding = run.encoding(cfg.data, ["rgb", *(maps if cfg.scales == "truth" else ())])
    found = choose(clips, encoding)
    for line in told(found.left_out):
        print(line, file=sys.stderr)
    chosen = found.clips[: cfg.limit or None]
    for clip in shown(chosen, len(chosen), "reading scenes"):
        scene = clip.sample.scene
        yield Request(
            key=clip.row["id"],
            picture=clip.row["sha256"],
            read=partial(_first, clip, encoding),
            condition=conditioning.of_scene(scene),
            paths=pictures.grips(clip, encoding),
            caption=captions.prompt(clip.row),
            fields={"asset.name": clip.row["object"], **{name: field_of(scene, name) for name in FIELDS}},
            clip=clip,
        )


def _first(clip: Clip, encoding: EncodeConfig) -> Array:
    """The first frame that is used of a clip, in the size of the run, (h, w, 3) uint8."""
    first = int(pictures.select(clip.row["frames"], encoding.frames, encoding.frame_select)[0])
    whole = clip.read("rgb", first, first + 1)
    small = pictures.shrink(whole, clip.row["width"] // encoding.width)[0]
    return np.asarray(np.round(small), np.uint8)


def truth(request: Request, name: str, run: TrainedRun, data: str) -> float:
    """The value of a map that was shown as 1 in the simulated clip, in the unit of the map."""
    assert request.clip is not None
    scale = pictures.video(request.clip, name, run.encoding(data, ["rgb", name])).scale
    assert scale is not None
    return scale


def _axis(condition: Condition, width: int, height: int) -> float | None:
    """Direction from the first grip to the second, counter-clockwise from image right [deg]; None if they coincide."""
    x1, y1, x2, y2 = condition.grips
    right, up = (x2 - x1) * width, (y1 - y2) * height
    return round(math.degrees(math.atan2(up, right)), 1) + 0.0 if right or up else None


def _object(path: str) -> str:
    """A name for the object in a picture: that of the file, unless a simulated object has it, whose split it is not."""
    name = path.replace("\\", "/").rpartition("/")[2].rpartition(".")[0] or "object"
    return name if class_of(name) == NONE else f"pictured {name}"
