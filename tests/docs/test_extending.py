"""docs/extending.md, followed word for word in a copy of the checkout: its files, then its commands."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from omegaconf import OmegaConf

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/extending.md").read_text(encoding="utf-8")
FILES = dict(re.findall(r"^`([\w/.]+)`:\n\n```(?:python|yaml)\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))
HELP, RUN, TEST = re.findall(r"^```sh\n(.*)\n(.*)\n(.*)\n```$", PAGE, re.MULTILINE)[0]
(OUTSIDE,) = re.findall(r"^```sh\n(.*)\n```$", PAGE, re.MULTILINE)
(ENTRY,) = re.findall(r"^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
SMALL = "solver.cells=40 camera.width=64 camera.height=64 capture.tracks=16 loading.speed=4 capture.frames=5"
"""Coarse, small and fast: damaged in the last of five frames."""
NAMES = ("neo_hookean_quadratic", "smooth_stretch", "swelling", "pebble", "rubber_quadratic", "rubber_smooth")


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the checkout with the files of the page."""
    folder = tmp_path_factory.mktemp("checkout")
    for name in ("src", "conf", "tests"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", folder)
    for name, content in FILES.items():
        assert not (folder / name).exists(), f"{name} is there already: the page must add something new"
        (folder / name).write_text(content, encoding="utf-8")
    return folder


def said(command: str, checkout: Path, path: str = "src") -> str:
    """What a command of the page prints; it must succeed."""
    python = f'"{sys.executable}"'
    environment = {**os.environ, "PYTHONPATH": path, "COLUMNS": "100"}
    done = subprocess.run(re.sub("^python", lambda _: python, command), shell=True, cwd=checkout, env=environment,
                          capture_output=True, text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def made(checkout: Path) -> Path:
    """The sample of the command of the page, on a small scene."""
    said(f"{RUN} {SMALL}", checkout)
    (meta,) = (checkout / "outputs").glob("*/meta.json")
    return meta.parent


def test_the_page_adds_four_modules_and_three_choices() -> None:
    folders = ["constitutive", "damage", "maps", "asset/objects"]
    assert {str(Path(name).parent) for name in FILES if name.endswith(".py")} == {f"src/fracsim/{f}" for f in folders}
    assert {Path(name).parent.name for name in FILES if name.endswith(".yaml")} == {"material", "fracture", "asset"}


def test_help_lists_each_new_name(checkout: Path) -> None:
    text = said(HELP, checkout)
    assert [name for name in NAMES if not re.search(rf"\b{name}\b", text)] == []


def test_the_command_runs_with_all_of_them(made: Path) -> None:
    """The scene names them, the sample has the map, and the new damage law has grown damage."""
    scene: Any = OmegaConf.load(made / "scene.yaml")
    assert (scene.material.law, scene.fracture.law, scene.asset.name) == NAMES[:2] + NAMES[3:4]
    meta = json.loads((made / "meta.json").read_text())
    assert meta["complete"]
    assert (set(meta["maps"]), meta["maps"]["swelling"]["channels"]) == ({"damage", "swelling"}, 1)
    assert (made / "maps" / "swelling.mkv").is_file()
    assert np.ptp(meta["ranges"]["swelling"][-1]) > 0.01
    assert 0 < meta["report"]["damaged"] < 1


def test_the_tests_of_the_project_accept_them(checkout: Path) -> None:
    """As many as there are: at least five of the law, one of the damage law, two of the map, ten of the object."""
    (passed,) = re.findall(r"(\d+) passed", said(f"{TEST} -v -p no:cacheprovider", checkout))
    assert int(passed) >= 18


def modules(folder: Path) -> None:
    """The laws and the map of the page as files of a folder."""
    for name, content in FILES.items():
        if name.endswith(".py") and "objects" not in name:
            (folder / Path(name).name).write_text(content, encoding="utf-8")


def test_modules_from_outside_are_chosen_by_their_paths(tmp_path: Path) -> None:
    """In a folder with nothing else; an edited one makes another sample."""
    modules(tmp_path)
    command = f"{OUTSIDE} {SMALL} capture.frames=2 material.nu=0.45"
    said(command, tmp_path, str(ROOT / "src"))
    (meta,) = (tmp_path / "outputs").glob("*/meta.json")
    assert (meta.parent / "maps" / "swelling.mkv").is_file()
    content = json.loads(meta.read_text())["content"]
    assert re.fullmatch(r"neo_hookean_quadratic:[0-9a-f]{64}", content["material.law"])
    assert "already there" in said(command, tmp_path, str(ROOT / "src"))
    with (tmp_path / "swelling.py").open("a") as file:
        file.write("# edited\n")
    said(command, tmp_path, str(ROOT / "src"))
    assert len(list((tmp_path / "outputs").glob("*/meta.json"))) == 2


def test_an_installed_package_offers_modules_by_name(tmp_path: Path) -> None:
    """Its entry points, as an installer writes them from the lines of the page."""
    package, about = tmp_path / "their_package", tmp_path / "their_package-1.0.dist-info"
    package.mkdir()
    about.mkdir()
    (package / "__init__.py").touch()
    modules(package)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their_package\nVersion: 1.0\n")
    group = re.sub(r'project\.entry-points\."(.*)"', r"\1", ENTRY).replace('"', "")
    (about / "entry_points.txt").write_text(group)
    path = os.pathsep.join([str(tmp_path), str(ROOT / "src")])
    assert re.search(r"\bstress \| swelling\b", said("python -m fracsim --help", tmp_path, path))
    asked = 'from fracsim import maps, registry; print(maps.load("swelling").__name__)'
    assert said(f"python -c '{asked}'", tmp_path, path) == "their_package.swelling\n"
