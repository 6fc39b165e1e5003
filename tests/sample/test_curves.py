"""report.png is drawn from whatever was recorded."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib
import pytest
from PIL import Image

from fracsim.sample.curves import plot

from .recording import HISTORY


@pytest.mark.parametrize(
    ("history", "report"),
    [
        (HISTORY, {"break_frame": 3}),
        (HISTORY, {"break_frame": None}),
        ({**HISTORY, "load": [1.0, 2.0]}, {"break_frame": 99}),
        ({}, {"break_frame": 3}),
    ],
)
def test_report_of_any_run(tmp_path: Path, history: dict[str, Sequence[float]], report: dict[str, int]) -> None:
    plot(history, report, tmp_path / "report.png", (1.5, 2.3))
    with Image.open(tmp_path / "report.png") as picture:
        assert min(picture.size) > 400


def test_report_leaves_pyplot_alone(tmp_path: Path) -> None:
    before = matplotlib.get_backend(auto_select=False)
    plot(HISTORY, {}, tmp_path / "report.png")
    assert matplotlib.get_backend(auto_select=False) == before
