"""Every line of code in docs/data.md runs on a small data set with a table; its lists are those of the code."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from fracsim.dataset import card, index
from fracsim.scene.classes import OBJECTS, split_of
from tests.command import environment

PAGE = (Path(__file__).parents[2] / "docs/data.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(python|sh)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
NEEDS = ("torch", "datasets", "webdataset")
"""Packages that a block may need and a machine may lack."""


@pytest.mark.parametrize(("language", "code"), BLOCKS)
def test_a_block_runs(language: str, code: str, copy: Path) -> None:
    for name in NEEDS:
        if f"from {name}" in code or f"import {name}" in code:
            pytest.importorskip(name)
    index.build(copy)
    files, path = [], copy.parent
    if language == "python":
        (path / "block.py").write_text(code)
        files = [["block.py"]]
    else:
        words = [shlex.split(line, comments=True) for line in code.splitlines()]
        files = [line[1:] for line in words if line[:1] == ["python"]]
        assert len(files) == len(words)
    for arguments in files:
        environ = environment(HF_HOME=str(path / "cache"), HF_HUB_OFFLINE="1")
        done = subprocess.run([sys.executable, *arguments], cwd=path, env=environ, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def test_the_page_has_blocks_of_all_readers() -> None:
    code = "".join(block for _, block in BLOCKS)
    for word in ("dataset index", "dataset verify", "dataset retry", "dataset card", "fracsim.dataset.open",
                 "DataLoader", "load_dataset"):  # fmt: skip
        assert word in code


def test_the_columns_are_those_of_the_code() -> None:
    assert "\n".join(card._columns()) in PAGE


def test_the_split_is_that_of_the_code() -> None:
    for kind, names in OBJECTS.items():
        by_split = [", ".join(n for n in names if split_of(n) == split) for split in ("train", "test")]
        assert f"| {kind} | {' | '.join(by_split)} |" in PAGE
