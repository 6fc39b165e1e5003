"""A data set of four small clips, made once; tests that change it get a copy."""

import shutil
from pathlib import Path

import pytest

from fracsim import compose
from fracsim.run import pipeline
from tests.command import SMALL

SCENES = (
    ("asset=bar", "material=rubber", "loading.speed=4", "capture.frames=8", "fracture=rubber_late"),
    ("asset=duck", "loading.speed=4", "loading.axis_deg=30", "capture.frames=8", "fracture.onset=5", "fracture.crit=7"),
    (
        "asset=star",
        "loading.speed=8",
        "capture.frames=8",
        "capture.maps=[damage]",
        "capture.rgb=false",
        "fracture.onset=2",
        "fracture.crit=10",
    ),
    ("asset=bread", "loading.grips=soft"),
)
"""Breaks at frame 5; never breaks; never breaks, without colour; suspect, since soft grips are a pull without books."""
STATUSES = ("complete", "never breaks", "never breaks", "suspect")


def small(*overrides: str) -> tuple[str, ...]:
    """The overrides of a small clip without curves."""
    return (*SMALL, "capture.report=false", *overrides)


@pytest.fixture(scope="session")
def folder(taichi: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The data set; it must not be changed."""
    path = tmp_path_factory.mktemp("sets") / "outputs"
    outcomes = [pipeline.run(compose(*small(*scene), f"output.folder={path}")) for scene in SCENES]
    assert tuple(outcome.status for outcome in outcomes) == STATUSES
    return path


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    """A copy of the data set, without a table."""
    path = tmp_path / "outputs"
    shutil.copytree(folder, path, ignore=shutil.ignore_patterns("metadata.parquet"))
    return path
