"""The table of a data set, metadata.parquet: one row a finished sample.

    python -m fracsim.dataset index DIR

Rows of samples that have not changed are kept; the table is replaced at once, so that a reader sees the old or the new
one. A sample that is being written meanwhile is left out until it is finished.
"""

import argparse
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from statistics import median
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fracsim.dataset import folders
from fracsim.dataset.command import command
from fracsim.dataset.progress import Progress, shown, silent
from fracsim.dataset.table import SCHEMA, Row, row_of
from fracsim.sample import schema
from fracsim.sample.folder import lacking
from fracsim.scene.classes import SPLITS

TABLE = "metadata.parquet"
VERSION = "1"
"""Version of the rules that make a row; another one makes all rows again."""
_VERSION_KEY = b"fracsim_table"
LEFT = 3600.0
"""Age at which a table that is not in place was left by a killed process [s]."""
STATUSES = ("complete", "never breaks", "suspect")


def build(folder: Path | str, progress: Progress = silent) -> Path:
    """Write metadata.parquet from the samples in `folder`, and return its path.

    Raises ValueError for a folder without samples, OSError where it cannot be written.
    """
    root = folders.root(folder)
    _save(_current(root, progress)[0], root)
    return root / TABLE


def table(folder: Path | str, progress: Progress = silent) -> pa.Table:
    """The table of the samples that are in `folder` now, sorted by path.

    A stale or missing metadata.parquet is written again, if the folder may be written to. Raises ValueError for a
    folder without samples.
    """
    root = folders.root(folder)
    found, changed = _current(root, progress)
    if changed:
        try:
            _save(found, root)
        except OSError:  # a data set may lie on a disk that is read only
            return found
    return found


def rows(folder: Path | str) -> list[Row]:
    """The rows of `table`, as dictionaries."""
    return list(table(folder).to_pylist())


def _current(root: Path, progress: Progress) -> tuple[pa.Table, bool]:
    """The table of the samples there are, and whether that on disk is another one."""
    there = dict(folders.finished(root))
    stored = load(root / TABLE)
    names = stored["path"].to_pylist()
    kept = [there.get(name) == written for name, written in zip(names, stored["written"].to_pylist(), strict=True)]
    changed = there.keys() - {name for name, keep in zip(names, kept, strict=True) if keep}
    new = [row for row in progress(_new_rows(root, sorted(changed), there), len(changed), "reading samples") if row]
    if all(kept) and not new and len(stored):
        return stored, False
    joined = pa.concat_tables([stored.filter(pa.array(kept, pa.bool_())), pa.Table.from_pylist(new, SCHEMA)])
    if not len(joined):
        raise ValueError(f"{root} holds no finished sample: give a folder that a sweep has written to, "
                         "or run python -m fracsim output.folder=FOLDER first.")  # fmt: skip
    return joined.sort_by("path").combine_chunks(), True


def _new_rows(root: Path, names: Iterable[str], written: dict[str, int]) -> Iterator[Row | None]:
    """The row of each sample, or None for one that is not whole: `verify` says why."""
    for name in names:
        try:
            meta = schema.read_meta(root / name)
            whole = meta["complete"] and not lacking(root / name, meta)
            yield row_of(root / name, meta, written[name]) if whole else None
        except (ValueError, KeyError, TypeError, OSError):
            yield None


def load(path: Path) -> pa.Table:
    """The table on disk, or an empty one when there is none of these columns and rules."""
    try:
        stored = pq.read_table(path)
    except (OSError, pa.ArrowInvalid):
        return SCHEMA.empty_table()
    mine = (stored.schema.metadata or {}).get(_VERSION_KEY) == VERSION.encode()
    same = mine and stored.schema.remove_metadata().equals(SCHEMA)
    return stored.replace_schema_metadata(None) if same else SCHEMA.empty_table()


def _save(rows: pa.Table, root: Path) -> None:
    """Replace metadata.parquet at once, and remove what a killed process has left of one."""
    for old in root.glob(f".{TABLE}.*"):
        with suppress(OSError):  # another process may have been faster
            if old.stat().st_mtime < time.time() - LEFT:
                old.unlink()
    new = root / f".{TABLE}.{os.getpid()}"
    try:
        pq.write_table(rows.replace_schema_metadata({_VERSION_KEY: VERSION}), new, compression="zstd")
        os.replace(new, root / TABLE)
    finally:
        new.unlink(missing_ok=True)


def summary(found: pa.Table) -> list[str]:
    """Lines for people: clips by class, split and status, and when they break."""
    every: list[Row] = found.to_pylist()
    lines = [f"{'class':<13} {'clips':>6} {'train':>6} {'test':>6} {'none':>6}   {'complete':>8} {'never breaks':>12} "
             f"{'suspect':>7}   break frame (least, median, most)   within training"]  # fmt: skip
    for kind in dict.fromkeys(row["class"] for row in every):
        mine = [row for row in every if row["class"] == kind]
        splits = " ".join(f"{sum(r['split'] == split for r in mine):>6}" for split in SPLITS)
        states = [sum(r["status"] == status for r in mine) for status in STATUSES]
        when = break_frames(mine)
        frames = f"{when[0]}, {median(when):g}, {when[-1]}" if when else "none"
        lines.append(f"{kind:<13} {len(mine):>6} {splits}   {states[0]:>8} {states[1]:>12} {states[2]:>7}   "
                     f"{frames:<33}   {sum(r['breaks_in_training'] for r in mine)}")  # fmt: skip
    return lines


def break_frames(rows: Iterable[Row]) -> list[int]:
    """The break frames of the clips that break, sorted."""
    return sorted(row["break_frame"] for row in rows if row["break_frame"] is not None)


def add(subparsers: Any) -> None:
    """The command `index`."""
    command(subparsers, "index", "write the table metadata.parquet", __doc__, run)


def run(arguments: argparse.Namespace) -> int:
    """Write the table and print what is in it."""
    path = build(arguments.folder, shown)
    print("\n".join(summary(pq.read_table(path))))
    print(f"{pq.read_metadata(path).num_rows} clips in {path}")
    return 0
