"""Draws of a parameter table: balanced, all different, repeatable, and weaker than what a user says."""

from collections import Counter
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from fracsim import compose, sample
from fracsim.sample.schema import load_scene
from fracsim.scene.program import SIMULATE
from fracsim.scene.space import Space, resolve
from tests.command import SMALL, fracsim_command, samples

DRAWS = 702
"""As many as the paper made of each object: 4,212 / 6 = 2,808 / 4."""
TABLE: dict[str, dict[str, list[Any]]] = {
    "low_stretch": {
        "material.E": [2e3, 6e3, 1e4],
        "material.nu": [0.2, 0.25, 0.3],
        "thresholds": [(1.5, 2.3), (2.0, 3.0)],
        "loading.speed": [0.5, 0.6, 0.7, 0.8],
    },
    "high_stretch": {
        "material.E": [2e4, 6e4, 1e5],
        "material.nu": [0.45, 0.47, 0.49],
        "thresholds": [(2.6, 3.0), (3.0, 3.3)],
        "loading.speed": [0.6, 0.8, 1.2, 1.4],
    },
}
"""The parameter table of the paper, by class."""
COMMON = {"loading.axis_deg": [15.0 * i for i in range(12)], "loading.offset": [0.1, 0.15, 0.2, 0.25]}
ASSETS = {"low_stretch": "bread", "high_stretch": "duck"}


def read(name: str) -> Space:
    """The space in a file of conf/space."""
    content: Any = OmegaConf.to_container(OmegaConf.load(SIMULATE.folder / "space" / f"{name}.yaml"))
    return Space(**content)


def draws(space: Space, seed: int = 0) -> list[dict[str, Any]]:
    seeded = replace(space, seed=seed)
    return [resolve(seeded, draw) for draw in range(space.draws)]


def spread(values: list[Any]) -> int:
    """Difference between the most and the least frequent value."""
    counts = Counter(values).values()
    return max(counts) - min(counts)


@pytest.mark.parametrize("name", TABLE)
def test_the_spaces_are_the_table_of_the_paper(name: str) -> None:
    rows = draws(read(name))
    assert len(rows) == DRAWS
    for row in rows:
        row["thresholds"] = (row.pop("fracture.onset"), row.pop("fracture.crit"))
    wanted = TABLE[name] | COMMON
    assert {field: sorted({row[field] for row in rows}) for field in wanted} == wanted
    assert all(set(row) == set(wanted) for row in rows)


@pytest.mark.parametrize("name", TABLE)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_draw_twice_and_every_value_as_often_as_possible(name: str, seed: int) -> None:
    """18 materials 39 times each; a loading value n_i or n_i + 1 times with each material, and so in the whole table.

    The same holds nearly for the 192 loadings: 702 / 192 = 3.7, and each is used between 1 and 8 times.
    """
    rows = draws(read(name), seed)
    assert len({tuple(row.values()) for row in rows}) == DRAWS
    materials: dict[Any, list[Any]] = {}
    loadings = [tuple(v for k, v in row.items() if k.startswith("loading.")) for row in rows]
    for row, loading in zip(rows, loadings, strict=True):
        materials.setdefault(tuple(v for k, v in row.items() if not k.startswith("loading.")), []).append(loading)
    assert [len(own) for own in materials.values()] == [39] * 18
    for own in [loadings, *materials.values()]:
        assert [spread([loading[axis] for loading in own]) <= 1 for axis in range(3)] == [True] * 3
    assert len(set(loadings)) == 192
    assert max(Counter(loadings).values()) <= 8


def test_consecutive_draws_go_round_the_materials() -> None:
    """So the first 18 draws see each material once."""
    first = draws(read("low_stretch"))[:18]
    assert len({tuple(v for k, v in row.items() if not k.startswith("loading.")) for row in first}) == 18


def test_a_draw_is_the_same_in_every_version() -> None:
    """Recorded values: a change would make other scenes of the same sweep."""
    first, last = resolve(read("low_stretch"), 0), resolve(replace(read("high_stretch"), seed=3), DRAWS - 1)
    assert list(first.values()) == [2e3, 0.2, 1.5, 2.3, 30.0, 0.2, 0.5]
    assert list(last.values()) == [1e5, 0.49, 3.0, 3.3, 0.0, 0.15, 1.2]


def test_another_seed_is_another_choice_of_loadings_for_the_same_materials() -> None:
    a, b = draws(read("low_stretch"), 0), draws(read("low_stretch"), 1)
    fixed = ("material.E", "material.nu", "fracture.onset", "fracture.crit")
    assert [[row[k] for k in fixed] for row in a] == [[row[k] for k in fixed] for row in b]
    assert a != b


def test_all_loadings_of_a_small_table() -> None:
    space = Space(materials={"material.nu": [0.1, 0.2]}, loadings={"loading.speed": [1.0, 2.0, 3.0]}, per_material=3)
    rows = sorted(tuple(resolve(space, draw).values()) for draw in range(6))
    assert rows == [(nu, v) for nu in (0.1, 0.2) for v in (1.0, 2.0, 3.0)]


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"materials": {"material.E": []}}, r"space\.materials: material\.E=\[\] must be a list of different values"),
        ({"loadings": {"seed": [1, 1]}}, r"space\.loadings: seed=\[1,1\] must be"),
        ({"loadings": {"seed": [1, 2]}, "per_material": 3}, r"per_material=3 is more than the 2 combinations"),
        ({"per_material": 0}, r"space\.per_material=0 is not allowed: it must be a whole number in \[1, inf\)"),
    ],
)
def test_a_table_that_cannot_be_drawn_from(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Space(**table)


@pytest.mark.parametrize("draw", [-1, 2])
def test_a_draw_that_is_not_there(draw: int) -> None:
    with pytest.raises(ValueError, match=rf"draw={draw} is not in .* 2 draws \(2 materials x 1 loadings\).*0 and 1"):
        resolve(Space(materials={"seed": [1, 2]}), draw)


@pytest.mark.parametrize("name", TABLE)
def test_a_draw_replaces_the_values_of_files_and_nothing_else(name: str) -> None:
    plain, drawn = (asdict(compose(f"asset={ASSETS[name]}", f"draw={draw}")) for draw in (-1, 123))
    for field, value in resolve(read(name), 123).items():
        section, _, leaf = field.partition(".")
        assert drawn[section][leaf] == value
        drawn[section][leaf] = plain[section][leaf]
    assert drawn == plain


def test_every_material_makes_a_valid_scene() -> None:
    """The first 18 draws see each material once."""
    for asset in ASSETS.values():
        for draw in (*range(18), DRAWS - 1):
            compose(f"asset={asset}", f"draw={draw}")


def test_what_a_user_says_wins_over_the_draw() -> None:
    drawn, said = compose("draw=3"), compose("loading.speed=0.2", "draw=3", "fracture.onset=1.2")
    assert (said.loading.speed, said.fracture.onset) == (0.2, 1.2)
    said.loading.speed, said.fracture.onset = drawn.loading.speed, drawn.fracture.onset
    assert said == drawn


def test_the_seed_and_the_table_of_the_user_are_used() -> None:
    """The seed of the scene is that of its particles: twins have the same row."""
    assert compose("draw=3", "seed=5").loading == compose("draw=3").loading
    other = resolve(replace(read("low_stretch"), seed=5), 3)
    assert compose("draw=3", "space.seed=5").loading == compose(*pairs(other)).loading
    assert compose("draw=3", "space=high_stretch").material.E in (2e4, 6e4, 1e5)
    with pytest.raises(ValueError, match=r"draw=18 .* 18 draws \(18 materials x 1 loadings\)"):
        compose("draw=18", "space.per_material=1")


def pairs(values: dict[str, Any]) -> list[str]:
    return [f"{field}={value}" for field, value in values.items()]


def test_the_command_shows_the_drawn_scene() -> None:
    """As it would be written to scene.yaml: neither draw nor space."""
    done = fracsim_command("asset=bread", "draw=3", "loading.speed=0.2", "-c", "job")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout == OmegaConf.to_yaml(compose("asset=bread", "draw=3", "loading.speed=0.2"))
    assert "draw" not in done.stdout


def test_draws_of_a_multirun_are_samples_that_their_scene_makes_again(tmp_path: Path) -> None:
    """`scene.yaml` holds the drawn values, so the sample needs neither the draw nor the table."""
    done = fracsim_command("-m", "draw=range(0,3)", *SMALL, f"output.folder={tmp_path}")
    assert (done.returncode, done.stderr) == (0, "")
    made = samples(tmp_path)
    assert [sample.read(p).scene for p in made] == [
        compose(f"draw={i}", *SMALL, f"output.folder={tmp_path}") for i in range(3)
    ]
    scene = load_scene(made[2] / "scene.yaml")
    assert sample.find(scene.output, sample.scene_id(scene)) == made[2]
