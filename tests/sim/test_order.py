"""Later thresholds tear later."""

import math

import pytest

from fracsim.bench.order import breaks, pulled, violations

CROISSANT = ("asset=croissant", "material.E=2000", "material.nu=0.25", "loading.speed=0.5", "loading.offset=0.25")
BREAD = ("asset=bread",)


def test_a_pair_is_violated_where_the_later_one_parts_earlier() -> None:
    frames = {(1.5, 2.3): 20.0, (2.0, 2.3): 19.0, (1.8, 3.0): 25.0, (2.0, 3.0): math.inf}
    assert violations(frames) == [((1.5, 2.3), (2.0, 2.3))]


@pytest.mark.parametrize(
    ("body", "early", "late"),
    [(CROISSANT, (1.5, 2.3), (2.0, 3.0)), (BREAD, (1.8, 2.3), (2.0, 2.3)), (BREAD, (2.0, 3.0), (2.3, 3.0))],
)
def test_later_thresholds_tear_later(
    body: tuple[str, ...], early: tuple[float, float], late: tuple[float, float]
) -> None:
    """Strands of material that could not fail used to join the pieces of the earlier ones until frames 56, 27 and 34,
    when the later ones had parted in frames 49, 25 and 31."""
    assert breaks(pulled(body, *early)) <= breaks(pulled(body, *late))
