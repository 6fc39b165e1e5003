"""Parameter tables: the values of the fields of a scene in draw number `draw` of a `Space`."""

import random
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, product
from math import prod
from typing import Any

from fracsim.scene.knob import check, describe, knob, text

Row = tuple[int, ...]
"""Which value of each list."""


@dataclass(kw_only=True)
class Space:
    """A parameter table: all combinations of material values, each with a balanced random choice of loadings.

    An entry of `materials` and `loadings` is a field with its values, `material.nu: [0.2, 0.3]`, or a section with
    values of several fields, `fracture: [{onset: 1.5, crit: 2.3}, {onset: 2.0, crit: 3.0}]`. Raises ValueError for an
    entry without values or with equal ones, and for more loadings a material than there are.
    """

    materials: dict[str, list[Any]] = knob({}, "fields with their values; each combination is a material")
    loadings: dict[str, list[Any]] = knob({}, "fields with their values; each material gets per_material different "
                                          "combinations, with each value about equally often")  # fmt: skip
    per_material: int = knob(
        1, "number of loadings of each material; the table has materials x per_material rows", least=1
    )
    seed: int = knob(0, "seed of the choice of loadings; the seed of the scene moves particles, not the table", least=0)

    def __post_init__(self) -> None:
        check(self, "space")
        for part in ("materials", "loadings"):
            for name, values in getattr(self, part).items():
                if not values or any(value in values[:i] for i, value in enumerate(values)):
                    raise ValueError(
                        f"space.{part}: {name}={text(values)} must be a list of different values, at least one: "
                        "give each value once."
                    )
        if self.per_material > (most := prod(map(len, self.loadings.values()))):
            raise ValueError(
                f"space.per_material={self.per_material} is more than the {most} combinations of space.loadings: "
                "lower space.per_material or add values."
            )

    @property
    def draws(self) -> int:
        """Number of draws: materials times loadings of each."""
        return prod(map(len, self.materials.values())) * self.per_material


@dataclass(kw_only=True)
class Draw:
    """What a configuration may hold beside its schema: one draw of a parameter table, and what follows a multirun."""

    # A list on the command line, which is a scene for each; one number here.
    draw: Any = knob(-1, "row of the parameter table `space`, from 0: sets the fields of the table, except those given "
                     "as FIELD=VALUE; -1 = no draw; a list of rows is a scene for each", least=-1)  # fmt: skip
    space: Space = field(default_factory=Space)
    logger: str = knob("csv", "what follows a multirun clip by clip: a table in the folder multirun, this and wandb, "
                       "or nothing", choices=("none", "csv", "wandb"))  # fmt: skip

    def __post_init__(self) -> None:
        if type(self.draw) is not int:
            raise ValueError(next(rule for _, _, rule in describe(Draw)).refusal("draw", self.draw, -1))
        check(self, "")


def resolve(space: Space, draw: int) -> dict[str, Any]:
    """Fields and values of draw number `draw` from 0 to space.draws - 1; equal arguments give equal values.

    Consecutive draws go round the materials: draw 0 is the first loading of the first material, draw 1 the first
    loading of the second. No two draws are equal. Raises ValueError when the space has no such draw.
    """
    if not 0 <= draw < space.draws:
        count = space.draws // space.per_material
        raise ValueError(
            f"draw={draw} is not in the parameter table, which has {space.draws} draws "
            f"({count} materials x {space.per_material} loadings): set draw between 0 and {space.draws - 1}."
        )
    materials = list(product(*space.materials.values()))
    loading, material = divmod(draw, len(materials))
    sizes = tuple(len(values) for values in space.loadings.values())
    row = _table(sizes, space.per_material, len(materials), space.seed)[material][loading]
    chosen = [values[i] for values, i in zip(space.loadings.values(), row, strict=True)]
    names = [*space.materials, *space.loadings]
    return {k: v for name, value in zip(names, [*materials[material], *chosen], strict=True)
            for k, v in _fields(name, value).items()}  # fmt: skip


def _fields(name: str, value: Any) -> dict[str, Any]:
    """The fields that one value of the entry `name` sets."""
    return {f"{name}.{leaf}": v for leaf, v in value.items()} if isinstance(value, dict) else {name: value}


@lru_cache(maxsize=8)
def _table(sizes: Row, rows: int, materials: int, seed: int) -> list[list[Row]]:
    """For each material `rows` different rows, chosen one by one from all combinations of `sizes` values.

    The next row is one with the values least used with this material; of those, one with the values, then the pairs,
    and so on, least used in the whole table; of those, a random one.
    """
    rng = random.Random(seed)  # random() gives the same numbers in every version of Python
    table: list[list[Row]] = []
    uses: Counter[Any] = Counter()
    for _ in range(materials):
        table.append([])
        own: Counter[Any] = Counter()
        for _ in range(rows):
            free = [row for row in product(*map(range, sizes)) if row not in table[-1]]
            load = [sum(own[value] for value in enumerate(row)) for row in free]
            least = min(load)
            rows_left = [row for row, n in zip(free, load, strict=True) if n == least]
            row = min(rows_left, key=lambda row: (*_uses(row, uses), rng.random()))
            own.update(enumerate(row))
            uses.update(part for k in range(1, len(row) + 1) for part in combinations(enumerate(row), k))
            table[-1].append(row)
    return table


def _uses(row: Row, uses: "Counter[Any]") -> Row:
    """How often the values of `row`, its pairs, ... and the whole row have been used."""
    return tuple(sum(uses[part] for part in combinations(enumerate(row), k)) for k in range(1, len(row) + 1))


def take(content: dict[str, Any], given: Collection[str]) -> dict[str, Any]:
    """Remove what is no field of a scene from the content of a configuration; set the drawn fields, save those `given`.

    Returns the fields set. Raises ValueError when draw or space are not allowed.
    """
    found = {key: content.pop(key) for key in ("draw", "space", "logger") if key in content}
    if found.get("draw", -1) == -1:
        return {}
    drawn = Draw(draw=found["draw"], space=Space(**found.get("space", {})))
    values = resolve(drawn.space, drawn.draw)
    wanted = {name: value for name, value in values.items() if name not in given}
    for name, value in wanted.items():
        section, _, leaf = name.rpartition(".")
        (content.setdefault(section, {}) if section else content)[leaf] = value
    return wanted
