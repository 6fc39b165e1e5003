"""The proof that a refactor is one: equal digests when nothing has changed, a named scene when something has."""

import json
from pathlib import Path

import pytest

from fracsim.lab import golden

SCENE = "object bar"


def test_the_same_code_gives_the_same_digests(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "golden.json"
    words = ["--only", SCENE, "--file", str(file)]
    assert golden.main([*words, "--write"]) == 0
    assert golden.main(words) == 0
    stored = json.loads(file.read_text())
    stored["scenes"][SCENE]["F"] = "0" * 16
    file.write_text(json.dumps(stored))
    capsys.readouterr()
    assert golden.main(words) == 1
    out = capsys.readouterr().out
    assert f"{SCENE} " in out
    assert "DIFFERS: F" in out


def test_the_file_has_all_scenes() -> None:
    stored = json.loads((Path(__file__).parents[2] / golden.FILE).read_text())
    assert set(stored["scenes"]) == set(golden.SCENES)
