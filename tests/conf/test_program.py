"""Several programs share conf/: each has its own groups, fields, help and errors, also in one process."""

import shutil
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.version import getbase

import fracsim
from fracsim import Scene
from fracsim.scene.knob import knob
from fracsim.scene.program import SIMULATE, Program
from tests.command import python

FILES = {
    "train.yaml": """\
# Train a video model.
#
#   python -m fracgen.train model=tiny
defaults:
  - train_config
  - model: tiny
  - backend: cpu
  - override hydra/help: train
  - _self_
""",
    "model/tiny.yaml": "# For tests.\nwidth: 8\n",
    "model/large.yaml": "# For results.\nwidth: 1536\n",
}
"""What a second package adds to conf/."""


@dataclass(kw_only=True)
class Model:
    """The network."""

    width: int = knob(64, "channels of a token", least=1)


@dataclass(kw_only=True)
class TrainConfig:
    """One training."""

    steps: int = knob(100, "optimiser steps", least=1)
    model: Model = field(default_factory=Model)
    backend: fracsim.Backend = field(default_factory=fracsim.Backend)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A copy of conf/ with the files of a second program."""
    shutil.copytree(SIMULATE.folder, tmp_path / "conf")
    shutil.rmtree(tmp_path / "conf" / "model")
    for name, text in FILES.items():
        (tmp_path / "conf" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "conf" / name).write_text(text)
    return tmp_path / "conf"


@pytest.fixture
def train(folder: Path) -> Program[TrainConfig]:
    return Program("fracgen.train", "train", TrainConfig, folder)


@pytest.fixture
def simulate(folder: Path) -> Program[Scene]:
    """fracsim beside it, from the same folder."""
    return Program("fracsim", "simulate", Scene, folder, optional=("sweep",))


def test_groups_are_those_of_the_primary_file(train: Program[TrainConfig], simulate: Program[Scene]) -> None:
    """`backend` belongs to both, `model` to one."""
    assert train.groups == {"backend": ("cpu", "cuda", "metal", "vulkan"), "model": ("large", "tiny")}
    assert simulate.groups == SIMULATE.groups
    assert "model" not in simulate.groups


def test_optional_and_renamed_groups_count_and_overrides_do_not(folder: Path) -> None:
    rows = ("schema", "optional model: null", "/backend@here: cpu", "override /camera: front")
    (folder / "other.yaml").write_text("defaults:\n" + "".join(f"  - {row}\n" for row in rows))
    assert list(Program("other", "other", Model, folder).groups) == ["backend", "model"]


def test_both_compose_in_one_process(train: Program[TrainConfig], simulate: Program[Scene]) -> None:
    for _ in range(2):
        config = train.compose("model=large", "steps=7")
        assert config == TrainConfig(steps=7, model=Model(width=1536))
        assert simulate.compose("asset=duck") == fracsim.compose("asset=duck")


def test_a_program_without_spaces_has_no_draw(train: Program[TrainConfig]) -> None:
    with pytest.raises(ValueError, match=r"draw=3 is not a field of a train config: choose one of backend, model"):
        train.compose("+draw=3")


def test_each_help_lists_its_own_groups_and_fields(train: Program[TrainConfig], simulate: Program[Scene]) -> None:
    ours, theirs = train.manual(), simulate.manual()
    assert ours.startswith("Train a video model.\n\n  python -m fracgen.train model=tiny\n\nFlags\n")
    assert "  model     large, tiny\n" in ours
    assert "model: The network.\n  model.width=8 " in ours  # that of the chosen file
    assert "the resolved train config" in ours
    assert not {"camera", "asset", "draw", "Scene", "scene"} & set(ours.replace("=", " ").replace(".", " ").split())
    assert "model" not in {line.split()[0] for line in theirs.splitlines() if line.strip()}
    assert theirs == SIMULATE.manual()


def test_errors_speak_of_their_own_program(train: Program[TrainConfig], simulate: Program[Scene]) -> None:
    with pytest.raises(ValueError, match=r"model\.widht=3 is not a field of a train config: did you mean model\.width"
                                         r"\? See python -m fracgen\.train --help\."):  # fmt: skip
        train.compose("model.widht=3")
    with pytest.raises(ValueError, match=r"seed=1 is not a field of a train config: choose one of backend, model, ste"):
        train.compose("+seed=1")
    with pytest.raises(ValueError, match=r"asset=duck cannot be used: .* See python -m fracgen\.train --help\."):
        train.compose("asset=duck")
    with pytest.raises(ValueError, match=r"model=huge is not known: choose one of large, tiny\."):
        train.compose("model=huge")
    with pytest.raises(ValueError, match=r"steps=many is not allowed: it must be a whole number in \[1, inf\)"):
        train.compose("steps=many")
    with pytest.raises(
        ValueError, match=r"model(\.\w+)?=tiny is not a field of a scene: .* See python -m fracsim --help\."
    ):
        simulate.compose("+model.tiny=tiny")


def test_composing_inside_another_hydra_program_leaves_it_as_it_was(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its configuration folder, its schema called `scene`, and its version of Hydra's behaviour."""
    (folder / "mine.yaml").write_text("defaults:\n  - scene\n  - _self_\n")
    monkeypatch.setattr(ConfigStore.instance(), "repo", deepcopy(ConfigStore.instance().repo))
    ConfigStore.instance().store(name="scene", node={"title": "a scene of their own"})
    with initialize_config_dir(str(folder), version_base="1.2"):
        assert fracsim.compose("asset=duck").asset.name == "duck"
        with pytest.raises(ValueError, match="asset=dog is not known"):
            fracsim.compose("asset=dog")
        assert hydra_compose("mine").title == "a scene of their own"
        assert str(getbase()) == "1.2"
    assert not GlobalHydra.instance().is_initialized()


def test_composing_in_a_job_of_another_hydra_program(tmp_path: Path) -> None:
    (tmp_path / "config.yaml").write_text("asset: duck\n")
    out = python(f"""
import sys
import hydra
import fracsim
sys.argv = ["job", "-m", "asset=duck,bear", "hydra.sweep.dir={tmp_path}/out"]
@hydra.main(config_path={str(tmp_path)!r}, config_name="config", version_base="1.3")
def job(cfg):
    print("asset", fracsim.compose(f"asset={{cfg.asset}}").asset.name)
job()
""")
    assert [line for line in out.splitlines() if line.startswith("asset")] == ["asset duck", "asset bear"]
