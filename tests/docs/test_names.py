"""Every function, module, file, page, field, layer and target that a page names exists."""

import importlib
import importlib.util
import inspect
import re
from dataclasses import is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from fracsim.scene.knob import describe
from fracsim.scene.program import SIMULATE

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    p.relative_to(ROOT).as_posix() for p in (*ROOT.glob("docs/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md")
)
SCHEMAS = {"encode": "EncodeConfig", "sample": "SampleConfig", "plan": "PlanConfig", "export": "ExportConfig",
           "evaluate": "EvaluateConfig",
           "train_vae": "TrainVaeConfig"}  # fmt: skip
"""Those of fracgen; the plan has the fields of a training too."""
CONFIGS = [getattr(importlib.import_module(f"fracgen.config.{module}"), name) for module, name in SCHEMAS.items()]
FIELDS = {name for config in (SIMULATE.config, *CONFIGS) for name, _, _ in describe(config)}
SYMBOLS = re.findall(r"^\| ([^|]+) \| ((?:`[\w.]+`(?:, )?)+) \| [^|]+ \| [^|]+ \| ((?:`fracsim[\w.:]+`(?:, )?)+) \|$",
                     (ROOT / "docs/symbols.md").read_text(), re.MULTILINE)  # fmt: skip


@cache
def text(page: str) -> str:
    """A page without the files that it adds to the code (docs/extending.md)."""
    added = r"^`[\w/.]+`:\n\n```(?:python|yaml)$.*?^```$"
    return re.sub(added, "", (ROOT / page).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def resolve(name: str) -> Any:
    """What `module:dotted` names; a field of a dataclass may have no value. Raises AttributeError or ImportError."""
    module, _, dotted = name.partition(":")
    found: Any = importlib.import_module(module)
    for part in filter(None, dotted.split(".")):
        annotated = is_dataclass(found) and part in found.__dataclass_fields__
        found = getattr(found, part, None) if annotated else getattr(found, part)
    return found


@pytest.mark.parametrize("page", PAGES)
def test_modules_and_functions_exist(page: str) -> None:
    for name in set(re.findall(r"`(frac(?:sim|gen)(?:\.\w+)*(?::[\w.]+)?)`", text(page))):
        resolve(name)


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_programs(page: str) -> None:
    for name in set(re.findall(r"python -m (frac(?:sim|gen)[\w.]*)", text(page))):
        assert importlib.util.find_spec(name.rstrip(".")), name
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    named = re.findall(r"`make ([a-z -]+)`", text(page)) + re.findall(r"^make ([a-z-]+) ", text(page), re.MULTILINE)
    assert set(" ".join(named).split()) <= targets


@pytest.mark.parametrize("page", PAGES)
def test_links_and_files_exist(page: str) -> None:
    """Links are relative to the page, files in code to the checkout."""
    folder = (ROOT / page).parent
    links = re.findall(r"\]\(([^)#:]+)\)", text(page)) + re.findall(r'src="([^"]+)"', text(page))
    assert [link for link in links if not (folder / link).exists()] == []
    for file, test in re.findall(r"`((?:src|tests|conf|docs)/[\w/.]+)(?:::(\w+))?`", text(page)):
        assert (ROOT / file).exists(), file
        assert not test or f"def {test}" in (ROOT / file).read_text(), test


@pytest.mark.parametrize("page", PAGES)
def test_fields_are_fields_of_a_program(page: str) -> None:
    sections = {name.partition(".")[0] for name in FIELDS if "." in name}
    named = set(re.findall(rf"`((?:{'|'.join(sections)})\.[a-z_]\w*)[`=]", text(page)))
    assert {name for name in named if not name.endswith((".py", ".md"))} - FIELDS == set()


@pytest.mark.parametrize(("symbol", "names", "where"), SYMBOLS)
def test_the_code_has_the_names_of_a_symbol(symbol: str, names: str, where: str) -> None:
    """Each is the end of a place, a field of a scene, or a word of the code there."""
    places = re.findall(r"`([^`]+)`", where)
    code = "".join(inspect.getsource(importlib.import_module(place.partition(":")[0])) for place in places)
    for place in places:
        resolve(place)
    for name in re.findall(r"`([^`]+)`", names):
        assert name in FIELDS or re.search(rf"\b{name}\b", code), name


def test_the_table_of_symbols_was_read() -> None:
    body = (ROOT / "docs/symbols.md").read_text()
    assert len(SYMBOLS) == len(re.findall(r"^\|.*`fracsim\.", body, re.MULTILINE)) > 40


def test_the_layers_are_those_of_the_linter() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text())
    contracts = config["tool"]["importlinter"]["contracts"][:2]
    layers = [set(re.findall(r"\w+", layer)) for contract in contracts for layer in contract["layers"]]
    table = re.findall(r"^\| (`.*?) \|", text("CONTRIBUTING.md"), re.MULTILINE)
    assert [set(re.findall(r"`(\w+)`", row)) for row in table] == layers


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150
