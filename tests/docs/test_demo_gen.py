"""make demo-gen: its commands compose, and each reads what the one before has written."""

import re
import shlex
from pathlib import Path

import pytest

from fracgen.encode import ENCODE
from fracgen.sample import SAMPLE
from fracgen.train import TRAIN
from fracgen.train_vae import PROGRAM as TRAIN_VAE

ROOT = Path(__file__).parents[2]
MAKEFILE = (ROOT / "Makefile").read_text()


def overrides(module: str) -> list[str]:
    """Of the command that make demo-gen gives to `module`."""
    ((recipe, _),) = re.findall(r"^demo-gen:.*\n((\t.*\n)+)", MAKEFILE, re.MULTILINE)
    (line,) = re.findall(rf"\$\(RUN\) {module} (.*)", recipe)
    (folder,) = re.findall(r"^DEMO := (.*)$", MAKEFILE, re.MULTILINE)
    line = re.sub(r"\$\$\(ls [^)]*\)[^)]*\)", "RUN", line)  # the run has the name that the training gives it
    return shlex.split(line.replace("$(DEMO)", folder))


def test_the_commands_of_demo_gen_fit_together() -> None:
    pytest.importorskip("torch")
    vae, cache, train, film = (program.compose(*overrides(name)) for program, name in (
        (TRAIN_VAE, "fracgen.train_vae"), (ENCODE, "fracgen.encode"), (TRAIN, "fracgen.train"),
        (SAMPLE, "fracgen.sample")))  # fmt: skip
    assert f"output.folder={vae.data}" in overrides("fracsim")
    assert {vae.data, cache.data, film.data} == {"outputs/demo_gen/clips"}
    assert cache.vae.path == film.vae.path == vae.output.folder
    assert (cache.vae.kind, cache.vae.base_dim) == (vae.vae.kind, vae.vae.base_dim)
    assert train.data.folder == cache.output.folder
    assert train.stages.stage1.streams == cache.streams
    assert f"$(DEMO)/{Path(train.output.folder).name}/stage1-*" in MAKEFILE
    assert cache.encoders == film.encoders


def test_readme_names_it() -> None:
    assert re.search(r"^make demo-gen ", (ROOT / "README.md").read_text(), re.MULTILINE)
