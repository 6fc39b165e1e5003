"""A sample says which laws and maps made it, and when another version of them would make it now."""

import json
from pathlib import Path
from typing import Any

import pytest

from fracsim import Capture, Material, Scene, registry
from fracsim.sample import scene_content, scene_id
from fracsim.sample.header import map_infos
from fracsim.sample.identity import digest
from fracsim.sample.origin import changes, sources
from fracsim.version import __version__

SCENE = Scene(capture=Capture(maps=["stress", "damage"]))


def meta(**sources_then: str) -> dict[str, Any]:
    """The entries that count of a sample of SCENE."""
    then = {**sources(SCENE), **{f"maps/{name}.py": value for name, value in sources_then.items()}}
    return {"sources": then, "provenance": {"fracsim": __version__}}


def test_the_sources_are_those_of_laws_and_maps_by_file() -> None:
    package = Path(registry.__file__).parent
    names = ["constitutive/fixed_corotated.py", "damage/stretch.py", "maps/stress.py", "maps/damage.py"]
    assert sources(SCENE) == {name: digest(package / name)[:12] for name in names}


def test_a_sample_of_the_present_program_has_nothing_to_say() -> None:
    assert changes(SCENE, meta()) == ""


def test_an_edited_map_is_named() -> None:
    said = changes(SCENE, meta(stress="0" * 12))
    assert said == f"made by fracsim {__version__} with another stress.py: output.overwrite=true makes it again"


def test_another_version_is_named() -> None:
    said = changes(SCENE, {**meta(), "provenance": {"fracsim": "0.0.1"}})
    assert said == "made by fracsim 0.0.1: output.overwrite=true makes it again"


def test_a_sample_from_before_sources_were_kept_says_nothing() -> None:
    assert changes(SCENE, {"provenance": {"fracsim": "0.0.1"}}) == ""


def law(path: Path, more: str = "") -> str:
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"psi = piola = bound_total = bound_updated = None\n{more}")
    return str(path)


def test_a_law_from_outside_counts_by_its_name_and_source(tmp_path: Path) -> None:
    """Not by its folder: a copy is the same law, and an edited one another."""
    one = Scene(material=Material(law=law(tmp_path / "a" / "mine.py")))
    copy = Scene(material=Material(law=law(tmp_path / "b" / "mine.py")))
    before = scene_id(one)
    assert before == scene_id(copy) != scene_id(Scene())
    content = scene_content(one)
    law(tmp_path / "a" / "mine.py", "# edited")
    assert scene_id(one) != before
    (tmp_path / "a" / "mine.py").unlink()
    assert scene_content(one, json.loads(json.dumps(content))) == content  # what `verify` asks of a sample


def test_an_edited_module_is_loaded_again(tmp_path: Path) -> None:
    path = law(tmp_path / "mine.py", "n = 1")
    assert registry.load("fracsim.constitutive", path, "material.law").n == 1
    law(tmp_path / "mine.py", "n = 2")
    assert registry.load("fracsim.constitutive", path, "material.law").n == 2


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("gone.py", None, r"material\.law=.*gone\.py is not a file"),
        ("my law.py", "", r"names no module"),
        ("mine.py", "psi = piola = 1", r"mine\.py lacks bound_total, bound_updated"),
        ("mine.py", "import nowhere", r"cannot be imported \(ModuleNotFoundError: No module named 'nowhere'\)"),
        ("mine.py", "def", r"cannot be imported \(SyntaxError"),
    ],
)
def test_a_bad_module_is_one_clear_error(name: str, content: str | None, said: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(ValueError, match=said):
        registry.load("fracsim.constitutive", str(tmp_path / name), "material.law")


def test_two_maps_of_one_name_are_refused(tmp_path: Path) -> None:
    (tmp_path / "flow.py").write_text("CHANNELS, UNIT, LABEL, SCALE, quantity = 1, '1', 'flow', None, None")
    assert set(map_infos([str(tmp_path / "flow.py"), "stress"])) == {"flow", "stress"}
    with pytest.raises(ValueError, match="two maps of one name"):
        map_infos([str(tmp_path / "flow.py"), "flow"])
