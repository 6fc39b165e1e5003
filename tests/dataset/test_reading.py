"""The benchmark of reading compares readers on the same stretches, and stores the sizes there are."""

from pathlib import Path

import numpy as np
import pytest

import fracsim.dataset
from fracsim.bench import reading

from . import tiny

for needed in ("av", "blosc2"):
    pytest.importorskip(needed)


def test_readers_read_the_same_stretches(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In turns, each in processes of its own; figures of every reader with one process and with two."""
    monkeypatch.setattr(reading, "READS", 2)
    clips = fracsim.dataset.open(tiny.make(tmp_path / "archive", 1))
    rows = list(reading.rows(clips, tmp_path / "packed", rounds=1))
    assert all(row.value > 0 for row in rows if "MB" not in row.unit)
    for name in reading.READERS.values():
        assert {row.unit for row in rows if row.variant.startswith(name)} >= {"s", "clips/s"}
    (whole,) = (row.value for row in rows if row.variant == "all files")
    assert whole == pytest.approx(clips[0].row["bytes"] / 1e6)
    seen = []
    for _ in range(2):
        seen.append([])
        reading.measure(list(clips), lambda clip, start: seen[-1].append(start), np.random.default_rng(3))
    assert seen[0] == seen[1]
