"""Pairs of grey videos, and what a metric has looked at."""

from pathlib import Path

import pytest

from tests.metrics.brightness import LOOKED
from tests.metrics.folders import film, grey


@pytest.fixture
def looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The clips that the metric has looked at, a line each."""
    path = tmp_path / "looked.txt"
    path.touch()
    monkeypatch.setenv(LOOKED, str(path))
    return path


@pytest.fixture
def films(tmp_path: Path) -> Path:
    """Three pairs of grey videos, whose differences are 10, 20 and 40 levels."""
    for name, level in {"a": 110, "b": 120, "c": 140}.items():
        film(tmp_path / "pred" / f"{name}.mkv", grey(level))
        film(tmp_path / "gt" / f"{name}.mkv", grey(100))
    return tmp_path
