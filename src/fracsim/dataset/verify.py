"""Check a data set: hash all files again and list what is wrong with it.

    python -m fracsim.dataset verify DIR

missing: planned, but not there. failed: tried, but not there. broken: not as it was written. incomplete: not finished.
duplicate: the same pictures as another sample. table: metadata.parquet is not that of the samples. suspect: as it was
written, but its numbers are not to be trusted; this alone is not wrong, since readers leave such samples out. Exit
status 1 when something is wrong. DIR may also be the folder of one sample.
"""

import argparse
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

from fracsim.dataset import folders, index
from fracsim.dataset.command import command
from fracsim.dataset.progress import Progress, shown, silent
from fracsim.dataset.table import VIDEOS, Row, fingerprint, row_of
from fracsim.run import journal
from fracsim.sample import schema, verify

KINDS = ("missing", "failed", "broken", "incomplete", "duplicate", "table", "suspect")
HARMLESS = ("suspect",)
"""Kinds of findings that are not wrong."""


class Finding(NamedTuple):
    """Something that `check` has found."""

    kind: str
    """One of KINDS."""
    name: str
    """The id of a sample, or the name of a file or a folder in the data set."""
    why: str


class Checked(NamedTuple):
    """A sample whose files have been hashed again."""

    name: str
    kind: str
    """broken, incomplete, or "" when it is as it was written."""
    why: str
    row: Row | None
    """Its row of the table, if it is as it was written."""
    pictures: str
    """Hash of its videos and tracks; "" when it has none."""


def check(folder: Path | str, planned: Iterable[str] = (), progress: Progress = silent) -> list[Finding]:
    """All findings of a data set or of one sample, in the order of KINDS; `planned` are ids that should be there.

    Raises ValueError for a folder without samples.
    """
    root = folders.root(folder)
    if (root / schema.META).is_file():
        return list(_of_samples([_checked(root)]))
    names = sorted({name for name, _ in folders.finished(root)} | set(folders.headless(root)))
    tried = attempts(root)
    if not (names or tried or folders.unfinished(root)):
        raise ValueError(f"{root} holds no samples: give a folder that a sweep has written to.")
    with ThreadPoolExecutor() as pool:  # hashing lets other threads run
        checked = list(progress(pool.map(lambda name: _checked(root / name), names), len(names), "hashing samples"))
    found = [*_absent(root, names, tried, planned), *_of_samples(checked), *_leftovers(root, names),
             *_of_table(root, checked)]  # fmt: skip
    return sorted(found, key=lambda finding: KINDS.index(finding.kind))


def attempts(root: Path) -> dict[str, dict[str, Any]]:
    """The last attempt at each id in the journal of the sweep."""
    return {entry["id"]: entry for entry in journal.read(root) if isinstance(entry, dict) and entry.get("id")}


def _checked(path: Path) -> Checked:
    """Hash a sample again."""
    problems = verify(path)
    try:
        meta = schema.read_meta(path)
        complete = bool(meta["complete"])
        row = None if problems else row_of(path, meta, (path / schema.META).stat().st_mtime_ns)
        return Checked(path.name, _kind(complete, problems), "; ".join(problems), row, _pictures(meta["files"]))
    except (ValueError, KeyError, TypeError, OSError) as error:
        return Checked(path.name, "broken", "; ".join(problems) or f"{schema.META} lacks {error}", None, "")


def _kind(complete: bool, problems: list[str]) -> str:
    if not complete:
        return "incomplete"
    return "broken" if problems else ""


def _pictures(files: Mapping[str, Any]) -> str:
    """Hash of what is filmed; of two samples of one scene it is equal, whatever else they hold."""
    filmed = {name: entry for name, entry in files.items() if name in (*VIDEOS.values(), schema.TRACKS)}
    return fingerprint(filmed) if filmed else ""


def _of_samples(checked: Iterable[Checked]) -> Iterator[Finding]:
    """What is wrong with samples that are there."""
    first: dict[str, str] = {}
    for sample in checked:
        if sample.kind:
            yield Finding(sample.kind, sample.name, sample.why)
        elif sample.row and sample.row["status"] == "suspect":
            yield Finding("suspect", sample.name, sample.row["reason"])
        other = first.setdefault(sample.pictures, sample.name)
        if sample.pictures and other != sample.name:
            yield Finding("duplicate", sample.name, f"has the pictures of {other}")


def _absent(
    root: Path, names: Iterable[str], tried: Mapping[str, Mapping[str, Any]], planned: Iterable[str]
) -> Iterator[Finding]:
    """What was planned, tried or finished and is not there."""
    there = set(names)
    for name, entry in tried.items():
        if name not in there and entry["status"] in ("failed", "interrupted"):
            yield Finding("failed", name, str(entry.get("reason", "")) or str(entry["status"]))
        elif name not in there:
            yield Finding("missing", name, f"{journal.JOURNAL} says {entry['status']}, but there is no such folder")
    for name in sorted({path.stem for path in failures(root)} - there - tried.keys()):
        yield Finding("failed", name, f"its scene is {journal.FAILURES}/{name}.yaml")
    for name in sorted(set(planned) - there - tried.keys()):
        yield Finding("missing", name, "planned, but never tried")


def failures(root: Path) -> list[Path]:
    """The scenes of failed draws."""
    return sorted((root / journal.FAILURES).glob("*.yaml"))


def _leftovers(root: Path, names: Iterable[str]) -> Iterator[Finding]:
    """Samples that were not finished, and of which no whole one is there."""
    for name in folders.unfinished(root):
        identity = name.partition(".")[0]
        try:
            why = schema.read_meta(root / name)["reason"]
        except (ValueError, KeyError):
            why = "holds nothing that can be read"
        if identity in set(names):
            why = f"left behind, {identity} is there: delete it"
        yield Finding("incomplete", name, str(why))


def _of_table(root: Path, checked: Iterable[Checked]) -> Iterator[Finding]:
    """Whether the table, if there is one, has the rows of the samples that are as they were written."""
    if not (root / index.TABLE).is_file():
        return
    wrong = {sample.name for sample in checked if sample.row is None}
    stored = [row for row in index.load(root / index.TABLE).to_pylist() if row["path"] not in wrong]
    if stored != [sample.row for sample in checked if sample.row]:
        yield Finding("table", index.TABLE, f"is not that of the samples: run python -m fracsim.dataset index {root}")


def add(subparsers: Any) -> None:
    """The command `verify`."""
    parser = command(subparsers, "verify", "hash all files again and list what is wrong", __doc__, run)
    parser.add_argument("--ids", metavar="FILE", type=Path, help="text file with the ids that should be there")


def run(arguments: argparse.Namespace) -> int:
    """Print a line a finding, and how many there are; returns 1 when something is wrong."""
    planned = arguments.ids.read_text(encoding="utf-8").split() if arguments.ids else ()
    found = check(arguments.folder, planned, shown)
    for finding in found:
        print(f"{finding.kind:<10} {finding.name}  {finding.why}")
    counts = Counter(finding.kind for finding in found)
    print(", ".join(f"{counts[kind]} {kind}" for kind in KINDS if counts[kind]) or "all as it was written")
    return int(any(finding.kind not in HARMLESS for finding in found))
