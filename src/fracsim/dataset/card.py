"""The card of a data set, README.md, made from its table: counts, histograms, thumbnails, how to read it, its origin.

python -m fracsim.dataset card DIR
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from fracsim.dataset import folders, index
from fracsim.dataset.command import command
from fracsim.dataset.histogram import histogram
from fracsim.dataset.progress import Progress, shown, silent
from fracsim.dataset.reader import TRUSTED, Clips, open
from fracsim.dataset.table import COLUMNS, FIELDS, Row, column_of
from fracsim.dataset.thumbnails import chosen, sheet
from fracsim.dataset.verify import attempts, failures
from fracsim.run.journal import JOURNAL
from fracsim.sample.schema import read_meta
from fracsim.scene.classes import TRAINING_FRAMES

CARD = "README.md"
THUMBNAILS = Path("sheets", "thumbnails.png")
TAGS = ("physics", "simulation", "fracture", "material-point-method")
"""How hubs file the data set."""
LICENCE, OTHER = "apache-2.0", "other"
"""Of clips of built-in objects, which have the licence of fracsim; and of others, unless it is given."""

HEAD = """\
---
license: {license}
pretty_name: {title}
size_categories:
- {size}
task_categories:
- image-to-video
- text-to-video
tags:
{tags}
configs:
{configs}---
"""
CONFIG = """\
- config_name: {name}
  data_files:
  - split: {split}
    path:
    - metadata.parquet
    - '*/*.mkv'
    - '*/maps/*.mkv'
  filters: {filters}
"""
READING = """\
With fracsim, in physical units and any range of frames (no Taichi, no GPU):

```python
import fracsim.dataset

clips = fracsim.dataset.open("{folder}"{suspect})
clip = clips.filter(split="{split}")[0]
frames = clip.read("{what}", 0, {frames})
```

With `datasets`, without fracsim; the table is part of it, and each video is a column (decoding needs torchcodec):

```python
from datasets import load_dataset

clips = load_dataset("videofolder", data_dir="{folder}", split="train", filters=[("split", "==", "{split}")])
print(clips.num_rows, clips.column_names)
```

The `split="train"` of `datasets` is its name for everything there is; the column `split` says what is for training.

With `webdataset`, from tar shards:

```sh
python -m fracsim.dataset export {folder} --to webdataset shards
```

```python
from glob import glob

from webdataset import WebDataset

for entry in WebDataset(sorted(glob("shards/{split}-*.tar")), shardshuffle=False).decode():
    print(entry["__key__"], entry["meta.json"]["caption"])
```
"""


def write(folder: Path | str, license: str = "", progress: Progress = silent) -> Path:
    """Write README.md and its thumbnails from the samples in `folder`; returns the path of the card.

    `license` is the identifier that hubs know; without one it is that of fracsim if all objects are built in. Raises
    ValueError for a folder without samples.
    """
    root = folders.root(folder)
    clips = open(root, suspect=True)
    picked = chosen(clips)
    pictured = sheet(progress(picked, len(picked), "drawing thumbnails"), root / THUMBNAILS)
    path = root / CARD
    path.write_text("\n".join(_lines(root, clips, license, pictured)) + "\n", encoding="utf-8")
    return path


def _lines(root: Path, clips: Clips, license: str, pictured: bool) -> Iterator[str]:
    """The card, line by line."""
    rows: list[Row] = clips.table.to_pylist()
    built_in = all(row["asset_kind"] == "builtin" for row in rows)
    license = license or (LICENCE if built_in else OTHER)
    title = f"{len(rows)} clips of objects that are pulled apart"
    yield HEAD.format(license=license, title=title, size=_size(len(rows)), tags="\n".join(f"- {tag}" for tag in TAGS),
                      configs=_configs(rows))  # fmt: skip
    yield f"# {title}\n"
    yield from _about(rows)
    if pictured:
        yield f"\n![one frame of {len(chosen(clips))} clips]({THUMBNAILS.as_posix()})"
    yield from ["\n## Counts\n", *_counts(root, rows)]
    yield from ["\n## When they break\n", *_breaks(rows)]
    yield from ["\n## Parameters\n", *_parameters(rows)]
    yield from ["\n## How to read\n", READING.format(folder=root.resolve().name, **_example(rows))]
    yield from ["## Columns\n", "`metadata.parquet` has one row a clip.\n", *_columns()]
    yield from ["\n## How it was made\n", *_origin(root, rows)]
    yield from ["\n## Licence\n", _licence(license, built_in)]


def _size(count: int) -> str:
    """The class of size that hubs know."""
    bounds = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"), (1e7, "1M<n<10M"))
    return next((name for bound, name in bounds if count < bound), "10M<n<100M")


def _configs(rows: Sequence[Row]) -> str:
    """One configuration a split there is, without suspect clips; and all clips."""
    there = [split for split in ("train", "test") if any(row["split"] == split for row in rows)]
    sound = '["status", "!=", "suspect"]'
    named = {"all": ("train", f"[{sound}]"),
             **{split: (split, f'[["split", "==", "{split}"], {sound}]') for split in there}}  # fmt: skip
    return "".join(CONFIG.format(name=name, split=split, filters=filters) for name, (split, filters) in named.items())


def _about(rows: Sequence[Row]) -> Iterator[str]:
    """What a clip holds, and how large it all is."""
    there = [c.name.removesuffix("_file_name") for c in COLUMNS if c.name.endswith("_file_name")]
    held = [name for name in there if any(row[f"{name}_file_name"] for row in rows)]
    frames, sizes = _span(rows, "frames"), sorted({f"{row['width']} x {row['height']}" for row in rows})
    total = sum(row["bytes"] for row in rows)
    yield f"Each clip films one object between two grips that move apart, in pixel-aligned videos: {', '.join(held)}."
    size = f"{total / 1e9:.3g} GB, {total / len(rows) / 1e6:.3g} MB a clip"
    yield f"{frames} frames of {', '.join(sizes)} pixels; {size}."


def _span(rows: Sequence[Row], column: str) -> str:
    """The values of a column from the least to the most."""
    values = [row[column] for row in rows if row[column] is not None]
    low, high = min(values), max(values)
    return f"{low:,.4g}" if low == high else f"{low:,.4g} to {high:,.4g}"


def _counts(root: Path, rows: Sequence[Row]) -> Iterator[str]:
    """Clips by object and status, and what was left out."""
    yield "| object | class | split | clips | complete | never breaks | suspect |"
    yield "|---|---|---|---|---|---|---|"
    kinds = sorted({(r["class"], r["split"], r["object"]) for r in rows}, key=lambda k: (k[0], k[1] != "train", k[2]))
    for kind, split, name in kinds:
        yield _count(f"{name} | {kind} | {split}", [r for r in rows if (r["class"], r["object"]) == (kind, name)])
    for split in dict.fromkeys(kind[1] for kind in kinds):
        yield _count(f"all | | {split}", [row for row in rows if row["split"] == split])
    if failed := failures(root):
        yield f"\n{len(failed)} draws failed and are not among these; their scenes are in `failures/`."
    yield ("\nA suspect clip has all its files, but its numbers are not to be trusted (column `reason`): "
           "`fracsim.dataset.open` leaves it out unless it is asked for.")  # fmt: skip


def _count(name: str, rows: Sequence[Row]) -> str:
    states = (sum(row["status"] == status for row in rows) for status in index.STATUSES)
    return f"| {name} | {len(rows)} | {' | '.join(map(str, states))} |"


def _breaks(rows: Sequence[Row]) -> Iterator[str]:
    """Break frames by class."""
    for kind in dict.fromkeys(row["class"] for row in rows):
        mine = [row for row in rows if row["class"] == kind]
        frames, early = index.break_frames(mine), sum(row["breaks_in_training"] for row in mine)
        yield (f"Class {kind}: {len(frames)} of {len(mine)} clips break, {early} of them within the {TRAINING_FRAMES} "
               f"frames of training{f', half of them by frame {median(frames):g}' if frames else ''}.\n")  # fmt: skip
        if frames:
            yield from ["```text", *histogram(frames), "```\n"]


def _parameters(rows: Sequence[Row]) -> Iterator[str]:
    """A histogram of each field that is not the same in all clips; and the values of the others."""
    fixed = []
    for field, (_, about, unit) in FIELDS.items():
        values = [_plain(row[column_of(field)]) for row in rows if row[column_of(field)] is not None]
        if len(set(values)) > 1:
            yield from [f"`{column_of(field)}`: {about}{f' [{unit}]' if unit else ''}\n", "```text"]
            yield from [*histogram(values), "```\n"]
        elif values:
            fixed.append(f"`{column_of(field)}` {values[0]}{f' {unit}' if unit else ''}")
    yield f"The same in all clips: {', '.join(fixed) or 'none'}."


def _plain(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list) else value


def _example(rows: Sequence[Row]) -> dict[str, Any]:
    """A split, what to read and a number of frames that are there."""
    row = max(rows, key=lambda row: (row["status"] in TRUSTED, row["split"] == "train"))
    there = [c.name for c in COLUMNS if c.name.endswith("_file_name") and row[c.name]]
    preferred = [name for name in ("stress_file_name", "rgb_file_name") if name in there]
    what = (preferred or there or ["rgb_file_name"])[0].removesuffix("_file_name")
    suspect = "" if row["status"] in TRUSTED else ", suspect=True"
    return {"suspect": suspect, "split": row["split"], "what": what, "frames": min(17, row["frames"])}


def _columns() -> Iterator[str]:
    yield "| column | unit | what it holds |"
    yield "|---|---|---|"
    for column in COLUMNS:
        yield f"| `{column.name}` | {column.unit} | {column.about} |"


def _origin(root: Path, rows: Sequence[Row]) -> Iterator[str]:
    """Versions and machines behind the samples, what the sweep was asked for, and what it took."""
    for producer in sorted({row["producer"] for row in rows}):
        mine = [row for row in rows if row["producer"] == producer]
        made = read_meta(root / mine[0]["path"])["provenance"]
        versions = ", ".join(f"{name} {value}" for name, value in made.items() if value not in (None, "", False))
        yield f"{len(mine)} clips by {producer}. The first one: {versions}."
    asked = [set(entry.get("overrides", ())) for entry in attempts(root).values()]
    if common := sorted(set.intersection(*asked)) if asked else []:
        yield f"\nAll attempts in `{JOURNAL}` had `{' '.join(common)}` in common."
    seconds = [row["seconds"] for row in rows]
    yield f"\nIt took {sum(seconds) / 3600:.3g} hours of processes, {median(seconds):.3g} s a clip (median)."
    yield "Each sample is made again from its own `scene.yaml`."


def _licence(license: str, built_in: bool) -> str:
    if built_in and license == LICENCE:
        return (
            "Apache-2.0, as fracsim: the objects are drawn by its code, and nothing in the clips comes from elsewhere."
        )
    return f"`{license}`. The objects are not all drawn by fracsim: their own licences hold for clips of them."


def add(subparsers: Any) -> None:
    """The command `card`."""
    parser = command(subparsers, "card", "write README.md from the samples", __doc__, run)
    parser.add_argument("--license", default="", help="identifier of the licence, as cc-by-4.0")


def run(arguments: argparse.Namespace) -> int:
    """Write the card and print where it lies."""
    print(write(arguments.folder, arguments.license, shown))
    return 0
