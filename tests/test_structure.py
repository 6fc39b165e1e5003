"""What CONTRIBUTING promises about the size of functions, counted by `python -m fracsim.lab.structure`."""

from pathlib import Path

import pytest

from fracsim.lab import structure

SRC = Path(structure.__file__).parents[2]


@pytest.fixture(scope="module", params=structure.PACKAGES)
def counts(request: pytest.FixtureRequest) -> structure.Counts:
    return structure.count(SRC, request.param)


def test_functions_fit_on_a_screen(counts: structure.Counts) -> None:
    assert counts.longest[0] <= structure.LONG, counts.longest


def test_calls_pass_few_positional_arguments(counts: structure.Counts) -> None:
    assert counts.most_arguments[0] <= structure.MANY, counts.most_arguments


def test_array_functions_give_shapes(counts: structure.Counts) -> None:
    assert counts.without_shapes == ()


def test_counts_of_a_small_tree(tmp_path: Path) -> None:
    """Two rooms and an arrow; a call of three arguments; one array function of two has a shape."""
    package = tmp_path / "fracsim"
    (package / "solve").mkdir(parents=True)
    for folder in (package, package / "solve"):
        (folder / "__init__.py").write_text("")
    (package / "records.py").write_text("Array = list\n")
    (package / "solve" / "a.py").write_text(
        "from fracsim.records import Array\n\n\n"
        'def f(x: Array) -> None:\n    """Shape (N, 3)."""\n    print(1, 2, 3)\n\n\n'
        'def g(x: Array) -> None:\n    """No shape."""\n'
    )
    c = structure.count(tmp_path, "fracsim")
    assert (c.rooms, c.arrows, c.longest, c.most_arguments[0]) == (2, 1, (3, "fracsim.solve.a:f"), 3)
    assert (c.array_functions, c.without_shapes) == (2, ("fracsim.solve.a:g",))
