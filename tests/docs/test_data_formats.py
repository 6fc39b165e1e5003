"""Every line of code of docs/data_formats.md runs, in its order, and gives what the page says."""

import re
import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fracsim.dataset.__main__ import main
from tests.dataset import tiny

PAGE = (Path(__file__).parents[2] / "docs" / "data_formats.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
OPTIONAL = ("cv2",)
"""What the page shows and the tests do not install."""


def run_shell(block: str) -> None:
    for line in block.splitlines():
        words = shlex.split(line)
        assert words[:3] == ["python", "-m", "fracsim.dataset"], line
        assert main(words[3:]) == 0, line


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The names that the page has defined at its end."""
    for name in ("av", "blosc2", "webdataset", "datasets"):
        pytest.importorskip(name)
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        patch.setenv("HF_DATASETS_CACHE", "cache")
        tiny.make(Path("outputs"), 4, width=512, height=64)
        for kind, block in BLOCKS:
            if kind == "sh":
                run_shell(block)
            elif all(find_spec(name) or f"import {name}\n" not in block for name in OPTIONAL):
                exec(block, names)
    return names


def test_all_tools_give_the_same_codes(told: dict[str, Any]) -> None:
    assert told["by_pyav"].dtype == told["by_imageio"].dtype == np.uint16
    assert (told["by_pyav"][1:4] == told["codes"][:, 0]).all()
    assert (told["by_imageio"] == told["by_pyav"]).all()
    assert (told["colour"] == told["clip"].read("rgb")).all()


def test_opencv_gives_them_too(told: dict[str, Any]) -> None:
    pytest.importorskip("cv2")
    assert (np.stack(told["by_opencv"]).reshape(told["by_pyav"].shape) == told["by_pyav"]).all()


def test_codes_become_the_values(told: dict[str, Any]) -> None:
    np.testing.assert_allclose(told["pascal"][1:4], told["stress"][..., 0], rtol=1e-6, atol=1e-3)
    np.testing.assert_allclose(told["values"][:, 0], told["stress"][..., 0], rtol=1e-6, atol=1e-3)


def test_the_other_loaders_gave_something(told: dict[str, Any]) -> None:
    assert told["entry"]["meta.json"]["split"] == "train"
    assert len(told["entry"]["stress.mkv"]["bytes"]) > 0
