"""What an import loads, each in a fresh process: light things stay light, and torch is never there."""

from pathlib import Path

import pytest

import fracsim
from fracsim import backend, compose
from fracsim.run import pipeline
from tests.command import SMALL, python

HEAVY = {"taichi", "torch", "trimesh", "hydra", "omegaconf", "scipy", "matplotlib", "rich", "plyfile", "imageio"}
LIGHT = ("fracsim.camera", "fracsim.codec", "fracsim.dataset", "fracsim.maps", "fracsim.records", "fracsim.registry",
         "fracsim.sample", "fracsim.scene.program")  # fmt: skip
"""What fracgen may import."""


def loaded(code: str) -> set[str]:
    """Top-level packages that are loaded after `code`."""
    return set(python(f"{code}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})").split())


def test_fracsim_and_its_vocabulary_load_nothing_heavy() -> None:
    """A scene can be described and checked with the standard library alone."""
    code = "import fracsim; fracsim.Scene(material=fracsim.Material(E=1e4))"
    assert not loaded(code) & {*HEAVY, "numpy"}


def test_names_of_fracsim_are_there_when_asked_for() -> None:
    assert loaded("import fracsim; fracsim.compose('asset=bar')") & HEAVY == {"hydra", "omegaconf"}
    assert "taichi" in loaded("import fracsim; fracsim.Run")
    with pytest.raises(AttributeError, match="no attribute 'Walk'"):
        _ = fracsim.Walk


@pytest.mark.parametrize("module", LIGHT)
def test_what_fracgen_uses_needs_no_taichi(module: str) -> None:
    assert not loaded(f"import {module}") & {"taichi", "torch", "trimesh", "hydra", "scipy", "matplotlib", "rich"}


@pytest.mark.parametrize(
    "module",
    ["train", "encode", "sample", "train_vae", "plan", "export", "evaluate", "tables", "annotate", "annotation.app"],
)
def test_the_help_of_fracgen_needs_no_torch(module: str) -> None:
    """Nor does an error of the configuration: both take a second."""
    assert not loaded(f"import fracgen.{module}") & {"torch", "lightning", "diffusers", "taichi"}


def test_a_sample_is_read_without_taichi(tmp_path: Path) -> None:
    """Colour, maps, tracks, curves, the scene and the check of the hashes."""
    path = pipeline.run(compose(*SMALL, f"output.folder={tmp_path}")).path
    code = f"""
from fracsim import sample
clip = sample.read({str(path)!r})
assert clip.rgb.shape == (4, 64, 64, 3) and clip.maps["stress"].max() > 0 and clip.tracks.xy.any()
assert clip.scene.asset.name == "bread" and len(clip.history["t"]) == 4 and sample.verify({str(path)!r}) == []
"""
    assert not loaded(code) & {"taichi", "torch", "trimesh", "hydra", "scipy", "matplotlib", "rich"}


def test_a_whole_run_never_needs_torch(tmp_path: Path) -> None:
    """With everything switched on, where torch cannot be imported even if it is installed."""
    code = f"""
import sys

class Without:
    def find_spec(self, name, *_):
        if name.partition(".")[0] == "torch":
            raise ImportError(name)

sys.meta_path.insert(0, Without())
from fracsim import compose
from fracsim.run import pipeline
extras = ("capture.gaussians=true", "capture.particles=true", "capture.frames=2", "output.folder={tmp_path}")
pipeline.run(compose(*{SMALL}, *extras)).sample()
"""
    assert "torch" not in loaded(code)


def test_taichi_is_started_once_and_keeps_quiet() -> None:
    """No greeting on standard output; a second start of the same kind does nothing, another kind is refused."""
    code = """
from fracsim import Backend, backend
backend.start(Backend(threads=1))
backend.start(Backend(threads=1))
try:
    backend.start(Backend(arch="cuda"))
except RuntimeError as error:
    print(error)
"""
    assert python(code) == "backend.arch=cuda cannot replace cpu in a running process: start a new one.\n"


def test_threads_are_those_there_are() -> None:
    available = backend.threads(compose().backend)
    assert available >= 1
    assert backend.threads(compose("backend.threads=1").backend) == 1
    assert backend.threads(compose("backend.threads=1000").backend) == available
