"""Reads a data set: a lazy sequence of clips, filtered by the columns of its table; no Taichi here."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any, overload

import pyarrow as pa

from fracsim.dataset import index
from fracsim.dataset.table import Row
from fracsim.records import Array
from fracsim.sample import Sample, read

TRUSTED = ("complete", "never breaks")
"""Statuses of the clips that `open` gives unless asked for all."""


class Columns(Row):
    """A row of the table, by the names of the columns; raises ValueError for an unknown one."""

    def __missing__(self, name: str) -> Any:
        raise ValueError(_unknown(name, self))


@dataclass(frozen=True, repr=False)
class Clip:
    """One clip: its row in the table, and its sample on disk, which is opened at first use."""

    row: Row
    """Values by the names of the columns."""
    folder: Path
    """Folder of the data set."""

    @cached_property
    def sample(self) -> Sample:
        """The sample, as `fracsim.sample.read` gives it; raises ValueError when it is no longer whole."""
        return read(self.folder / self.row["path"])

    def read(self, what: str, start: int = 0, stop: int | None = None, over_alpha: bool = False) -> Array:
        """Frames start .. stop - 1 of "rgb" [T, H, W, 3] uint8, "alpha" [T, H, W] or a map [T, H, W, C], in its unit.

        With `over_alpha` a map is the quantity itself, not weighted by coverage. Decodes these frames only. Raises
        ValueError as `fracsim.sample.Sample.read` does.
        """
        return self.sample.read(what, start, stop, over_alpha)

    def __repr__(self) -> str:
        return f"Clip {self.row['id']}: {self.row['caption']}"


class Clips(Sequence[Clip]):
    """A lazy sequence of clips: only the table is in memory. It can be sent to other processes."""

    def __init__(self, folder: Path, table: pa.Table) -> None:
        self.folder = folder
        self.table: pa.Table = table
        """One row a clip."""

    def __len__(self) -> int:
        return int(self.table.num_rows)

    @overload
    def __getitem__(self, key: int) -> Clip: ...
    @overload
    def __getitem__(self, key: slice) -> "Clips": ...
    def __getitem__(self, key: int | slice) -> "Clip | Clips":
        numbers = range(len(self))[key]  # raises IndexError
        if isinstance(numbers, range):
            return self.take(numbers)
        return Clip(Columns(self.table.slice(numbers, 1).to_pylist()[0]), self.folder)

    def __iter__(self) -> Iterator[Clip]:
        for batch in self.table.to_batches(max_chunksize=1000):
            for row in batch.to_pylist():
                yield Clip(Columns(row), self.folder)

    def take(self, numbers: Sequence[int]) -> "Clips":
        """The clips of these numbers, in this order; raises IndexError for one that is not there."""
        return Clips(self.folder, self.table.take(pa.array(numbers, pa.int64())))

    def filter(self, predicate: Callable[[Row], bool] | None = None, **conditions: Any) -> "Clips":
        """The clips whose row satisfies `predicate` and has the given values in the given columns.

        A list, tuple or set of values admits each of them. Raises ValueError for an unknown column.
        """
        clips = self
        for name, value in conditions.items():
            if name not in self.table.column_names:
                raise ValueError(_unknown(name, self.table.column_names))
            admitted = _several(value)
            clips = clips._where(entry in admitted for entry in clips.table[name].to_pylist())
        return clips if predicate is None else clips._where(predicate(clip.row) for clip in clips)

    def _where(self, keep: Iterable[bool]) -> "Clips":
        return Clips(self.folder, self.table.filter(pa.array([bool(k) for k in keep], pa.bool_())))

    def __repr__(self) -> str:
        objects = dict.fromkeys(self.table["object"].to_pylist())
        return f"{len(self)} clips of {', '.join(objects) or 'no object'} in {self.folder}"


def open(folder: Path | str, suspect: bool = False) -> Clips:
    """The clips in `folder`, sorted by path; those whose numbers are not to be trusted only with `suspect`.

    Makes metadata.parquet again when it does not match the samples. Raises ValueError for a folder without samples.
    """
    clips = Clips(Path(folder).expanduser().absolute(), index.table(folder))
    return clips if suspect else clips.filter(status=TRUSTED)


def _several(value: Any) -> tuple[Any, ...]:
    """The values that a condition admits."""
    return tuple(value) if isinstance(value, (list, tuple, set, frozenset)) else (value,)


def _unknown(name: str, columns: Iterable[str]) -> str:
    """The error for a column that is not there."""
    names = list(columns)
    near = get_close_matches(name.replace(".", "_"), names, n=1)
    way_out = f"did you mean {near[0]}?" if near else f"choose one of {', '.join(names)}."
    return f"{name} is not a column of the table: {way_out}"
