"""conf/ and `fracsim.scene.vocab` say the same, and the presets hold the numbers that were decided."""

import importlib
import math
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from fracsim import Scene, compose, registry
from fracsim.scene.knob import describe
from fracsim.scene.program import SIMULATE
from fracsim.scene.vocab import DT0, H0

FILES = [SIMULATE.folder / group / f"{choice}.yaml" for group, choices in SIMULATE.groups.items() for choice in choices]
FIELDS = {name for name, _, _ in describe(SIMULATE.config)}
OBJECTS = registry.names("fracsim.asset.objects")


def name(file: Path) -> str:
    return f"{file.parent.name}={file.stem}"


OF_FILES = ("asset=mesh", "asset=ply", "asset=image")


def keys(file: Path) -> set[str]:
    """The fields that a file sets, as section.field."""
    content: Any = OmegaConf.to_container(OmegaConf.load(file), resolve=False)
    content.pop("defaults", None)
    if "@package _global_" not in file.read_text():
        content = {file.parent.name: content}
    return {f"{k}.{leaf}" if isinstance(v, dict) else k for k, v in content.items()
            for leaf in (v if isinstance(v, dict) else [""])}  # fmt: skip


def choice(file: Path) -> list[str]:
    """What a user types for a file; objects from files need a path."""
    return [name(file)] + ["asset.path=FILE"] * (name(file) in OF_FILES)


@pytest.mark.parametrize("file", FILES, ids=name)
def test_every_file_composes_and_has_its_way(file: Path) -> None:
    """Composing runs the validation of every section; what the file sets arrives in the scene."""
    scene = OmegaConf.structured(compose(*choice(file)))
    content = OmegaConf.load(file)
    for key in keys(file):
        written = OmegaConf.select(content, key if "@package _global_" in file.read_text() else key.partition(".")[2])
        used_up = key.startswith("space.")  # by the draw; see test_space.py
        assert used_up or OmegaConf.select(scene, key) == written or name(file) in OF_FILES


@pytest.mark.parametrize("file", FILES, ids=name)
def test_every_key_is_a_field(file: Path) -> None:
    assert keys(file) <= FIELDS


@pytest.mark.parametrize("file", FILES, ids=name)
def test_every_file_says_what_it_is(file: Path) -> None:
    comments = [line for line in file.read_text().splitlines() if line.startswith("# ") and "@package" not in line]
    assert comments


def test_a_group_is_a_field_of_the_scene_and_is_chosen_by_default() -> None:
    """One folder for each section that has choices; a draw uses up `space`. The others are single values."""
    single = ("seed", "condition", "output")
    assert all(SIMULATE.groups.values())
    assert {f.name for f in fields(Scene)} == {*SIMULATE.groups, *single} - {"space"}
    assert {f.name for f in fields(SIMULATE.config)} == {*SIMULATE.groups, *single, "draw", "logger"}


def test_every_field_is_typed_documented_and_bounded() -> None:
    """Numbers have a range, or a kind of their own; words have choices unless they are names, paths or plug-ins."""
    free = {"quality", "condition", "asset.path", "asset.mask", "asset.interior", "output.folder", "space.materials",
            "space.loadings"}  # fmt: skip
    for field, default, knob in describe(SIMULATE.config):
        assert len(knob.doc) > 5, field
        assert knob.allowed() or field in free or isinstance(default, bool), field
    leaves = [f for section in fields(Scene) if is_dataclass(section.type) for f in fields(section.type)]  # type: ignore[arg-type]
    assert all("knob" in f.metadata for f in leaves)


@pytest.mark.parametrize(("package", "group"), [("fracsim.constitutive", "material"), ("fracsim.damage", "fracture")])
def test_every_law_has_a_file_that_names_it(package: str, group: str) -> None:
    named = {getattr(compose(name(f)), group).law for f in FILES if f.parent.name == group}
    assert named == set(registry.names(package))


def test_every_built_in_object_and_map_can_be_chosen() -> None:
    """One file and one YAML for each object; the default scene records all maps."""
    assert set(SIMULATE.groups["asset"]) == {*OBJECTS, "mesh", "ply", "image"}
    assert set(compose().capture.maps) <= set(registry.names("fracsim.maps"))


def test_the_default_scene() -> None:
    """The paper's resolution, material of the low-stretch class, object and grips; no gravity."""
    s = compose()
    assert (s.quality, s.asset.kind, s.asset.name, s.asset.size) == ("default", "builtin", "bread", 0.6)
    assert (s.solver.formulation, s.solver.cells, s.solver.dt, s.solver.damping) == ("total", 150, "auto", "physical")
    assert (s.capture.frames, s.capture.fps, s.camera.width, s.camera.height) == (100, 100.0, 512, 512)
    assert (s.loading.thickness, s.loading.grips, s.loading.gravity) == (0.05, "rigid", [0.0, 0.0, 0.0])
    assert (s.material.density, s.backend.arch, s.fracture.at_grips) == (200.0, "cpu", False)


@pytest.mark.parametrize(
    ("material", "law", "E", "nu", "rpic", "keep"),
    [
        ("bread", "fixed_corotated", 6e3, 0.25, 0.5, 0.9995),
        ("rubber", "neo_hookean", 2e4, 0.45, 0.005, 0.9998),
        ("rubber_decoupled", "neo_hookean_decoupled", 2e4, 0.45, 0.005, 0.9998),
    ],
)
def test_materials_are_those_of_the_paper(material: str, law: str, E: float, nu: float, rpic: float, keep: float):
    """Damping as a viscosity r rho h0^2 / (4 dt0) and a rate -ln(g) / dt0; the files have eight digits."""
    m = compose(f"material={material}").material
    assert (m.law, m.E, m.nu, m.density) == (law, E, nu, 200.0)
    assert m.viscosity == pytest.approx(rpic * 200.0 * H0**2 / (4 * DT0), rel=1e-7)
    assert m.decay == pytest.approx(-math.log(keep) / DT0, rel=1e-7)


@pytest.mark.parametrize(
    ("fracture", "onset", "crit"),
    [("bread", 1.5, 2.3), ("bread_late", 2.0, 3.0), ("rubber", 2.6, 3.0), ("rubber_late", 3.0, 3.3)],
)
def test_thresholds(fracture: str, onset: float, crit: float) -> None:
    f = compose(f"fracture={fracture}").fracture
    assert (f.law, f.onset, f.crit) == ("stretch", onset, crit)


def test_quality_paper_is_the_paper_literally() -> None:
    s = compose("quality=paper")
    assert (s.quality, s.solver.formulation, s.solver.cells) == ("paper", "updated", 150)
    assert (s.solver.dt, s.solver.dt_override, s.solver.damping) == (1e-4, True, "per_substep")


def test_quality_preview_is_coarser_and_reference_finer() -> None:
    default, preview, reference = (compose(f"quality={q}") for q in ("default", "preview", "reference"))
    assert preview.solver.cells < default.solver.cells
    assert preview.camera.width < default.camera.width
    assert (reference.solver.precision, reference.solver.safety) == ("float64", default.solver.safety / 2)


@pytest.mark.parametrize("asset", [name for name in OBJECTS if name != "bar"])
def test_an_object_brings_the_material_thresholds_and_table_of_its_class(asset: str) -> None:
    """The bar is a test body of any material."""
    stretch = importlib.import_module(f"fracsim.asset.objects.{asset}").CLASS
    kind = {"low_stretch": "bread", "high_stretch": "rubber"}[stretch]
    for draw in ("draw=-1", "draw=5"):
        alone = compose(f"asset={asset}", draw)
        chosen = compose(f"material={kind}", f"fracture={kind}", f"space={stretch}", draw)
        assert (alone.asset.kind, alone.asset.name) == ("builtin", asset)
        assert (alone.material, alone.fracture, alone.loading) == (chosen.material, chosen.fracture, chosen.loading)


@pytest.mark.parametrize(
    ("overrides", "law", "onset"),
    [
        (("asset=duck", "material=bread"), "fixed_corotated", 1.5),
        (("material=bread", "asset=duck"), "fixed_corotated", 1.5),
        (("asset=duck", "fracture=rubber_late"), "neo_hookean", 3.0),
        (("asset=duck", "material=bread", "fracture=rubber"), "fixed_corotated", 2.6),
        (("asset=duck", "fracture.onset=1.2"), "neo_hookean", 1.2),
        (("asset=mesh", "asset.path=FILE", "material=rubber"), "neo_hookean", 2.6),
    ],
)
def test_what_the_user_says_wins(overrides: tuple[str, ...], law: str, onset: float) -> None:
    s = compose(*overrides)
    assert (s.material.law, s.fracture.onset) == (law, onset)


@pytest.mark.parametrize("quality", ["paper", "reference"])
def test_the_solver_a_user_chooses_wins_over_a_quality(quality: str) -> None:
    for formulation in ("total", "updated"):
        assert compose(f"quality={quality}", f"solver={formulation}").solver.formulation == formulation


def test_groups_of_one_section_keep_to_it() -> None:
    """capture=maps, loading=soft, camera=oblique and backend=cuda change their own section only."""
    default = compose()
    for group in ("capture=maps", "loading=soft", "camera=oblique", "backend=cuda"):
        changed = compose(group)
        differ = [f.name for f in fields(Scene) if getattr(changed, f.name) != getattr(default, f.name)]
        assert differ == [group.partition("=")[0]]
