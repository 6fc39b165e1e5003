"""What the documents name exists."""

import importlib
import re
from pathlib import Path

import pytest

from fracsim.sample import scene_id
from fracsim.scene.knob import describe
from fracsim.scene.program import compose
from fracsim.scene.vocab import Scene

ROOT = Path(__file__).parents[2]
ROWS = re.findall(r"^\|[^|]*\|[^|]*\| `([\w.]+):(\w+)` \| `([\w/.]+)(?:::(\w+))?` \|$",
                  (ROOT / "docs/equations.md").read_text(), re.MULTILINE)  # fmt: skip


def test_the_table_of_equations_was_read() -> None:
    body = (ROOT / "docs/equations.md").read_text()
    assert len(ROWS) == body.count("\n|") - 2 > 10


@pytest.mark.parametrize(("module", "function", "file", "test"), ROWS)
def test_function_and_test_of_an_equation_exist(module: str, function: str, file: str, test: str) -> None:
    assert hasattr(importlib.import_module(module), function)
    assert f"def {test}" in (ROOT / file).read_text()


def test_knobs_in_readme_are_fields_of_a_scene() -> None:
    fields = {name for name, _, _ in describe(Scene)}
    text = (ROOT / "README.md").read_text()
    sections = "asset|material|fracture|loading|solver|camera|capture|backend|output"
    named = set(re.findall(rf"\b((?:{sections})\.\w+)=", text))
    assert named
    assert named <= fields, named - fields


def test_pictures_in_readme_exist() -> None:
    text = (ROOT / "README.md").read_text()
    for path in re.findall(r"\]\((docs/[^)]+)\)|src=\"(docs/[^\"]+)\"", text):
        assert (ROOT / (path[0] or path[1])).exists(), path


def test_the_sample_that_readme_reads_is_that_of_make_demo() -> None:
    """Its folder is named after the scene: another default of a field gives it a new name."""
    (overrides,) = re.findall(r"fracsim (capture\.frames=\d+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    (folder,) = re.findall(r'sample\.read\("outputs/(\w+)"\)', (ROOT / "README.md").read_text())
    assert folder == scene_id(compose(overrides))
