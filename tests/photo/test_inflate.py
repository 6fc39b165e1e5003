"""The membrane under pressure against its closed forms."""

import numpy as np
import pytest

from fracsim.asset.inflate import inflate
from tests.photo import drawn


def disc(n: int = 300) -> "np.ndarray[tuple[int, int], np.dtype[np.bool_]]":
    return drawn.ellipse(n, n, (n / 2, n / 2, n / 2, n / 2))


def test_a_disc_becomes_a_ball() -> None:
    """h^2 = R^2 - r^2 with R = 1/2 at depth 1; the grid has 160 points across: 1 % of R^2."""
    relief = inflate(disc(), 1.0)
    x, y = np.meshgrid(np.linspace(-0.45, 0.45, 19), np.linspace(-0.45, 0.45, 19))
    inside = np.hypot(x, y) < 0.47
    u, ux, uy = relief(x[inside], y[inside])
    assert u == pytest.approx(0.25 - x[inside] ** 2 - y[inside] ** 2, abs=0.0025)
    assert ux == pytest.approx(-2 * x[inside], abs=0.03)
    assert uy == pytest.approx(-2 * y[inside], abs=0.03)


def test_u_changes_sign_at_the_outline() -> None:
    """Within a tenth of a grid point on average, and half a one everywhere: corners of pixels stay."""
    relief, angle = inflate(disc(), 1.0), np.linspace(0, 2 * np.pi, 200)
    u, ux, uy = relief(0.5 * np.cos(angle), 0.5 * np.sin(angle))
    off = u / np.hypot(ux, uy) * 160
    assert abs(off.mean()) < 0.1
    assert np.abs(off).max() < 0.5


def test_a_long_strip_becomes_a_cylinder_with_an_elliptical_section() -> None:
    """Far from its ends u is a parabola across it: 1 - (y / b)^2 of its largest value."""
    relief = inflate(np.ones((60, 400), bool), 0.8)
    half = 60 / 400 / 2
    y = np.linspace(-0.8, 0.8, 9) * half
    u = relief(np.zeros(9), y)[0]
    assert u == pytest.approx((0.8 * half) ** 2 * (1 - (y / half) ** 2), rel=0.03)


@pytest.mark.parametrize("flat", [False, True])
def test_depth_is_that_of_the_whole_body_in_its_smaller_side(flat: bool) -> None:
    """Both halves together, or the front alone."""
    relief = inflate(drawn.ellipse(300, 200, (150, 100, 150, 100)), 0.6, flat_back=flat)
    assert relief.top * (1 if flat else 2) == pytest.approx(0.6 * 2 / 3, rel=1e-6)


def test_on_a_flat_base_half_a_disc_is_half_a_ball() -> None:
    """It does not close below: u there is that of the ball's middle, with no slope downwards."""
    relief, x = inflate(disc()[:150], 2.0, flat_base=True), np.linspace(-0.4, 0.4, 9)
    u, _, uy = relief(x, np.full(9, -0.25))
    assert u == pytest.approx(0.25 - x**2, abs=0.004)
    assert uy == pytest.approx(np.zeros(9), abs=0.03)
    assert relief.beyond(np.zeros(3), np.array([-0.30, -0.25, -0.20])) == pytest.approx([0.05, 0, -0.05], abs=0.002)


def test_a_rounded_foot_is_as_thick_as_the_body_above_it() -> None:
    """A disc stands on the lowest 12 % of its height: at its lowest point it is thick, and cut by the outline."""
    closed, standing = inflate(disc(), 1.0), inflate(disc(), 1.0, flat_base=True)
    one = np.zeros(1)
    assert closed(one, one - 0.49)[0] < 0.012
    assert standing(one, one - 0.49)[0] > 0.12
    assert standing.beyond(one, one - 0.51) == pytest.approx(0.01, abs=0.002)


def test_thin_parts_are_thin() -> None:
    """A rectangle with a limb a fifth as wide. In the limb u is that of a strip, 2 b^2, in the rectangle that of
    Saint-Venant's torsion, 2 b^2 (1 - 32 / pi^3 sum); the limb's root adds a little to that.
    """
    mask = np.zeros((100, 300), bool)
    mask[:, :150] = True
    mask[40:60, 150:] = True
    u = inflate(mask, 1.0)(np.array([-0.25, 0.4]), np.zeros(2))[0]
    n = 2 * np.arange(20) + 1
    torsion = 1 - 32 / np.pi**3 * np.sum((-1.0) ** np.arange(20) / (n**3 * np.cosh(n * np.pi * 75 / 100)))
    assert np.sqrt(u[1] / u[0]) == pytest.approx(0.2 / np.sqrt(torsion), rel=0.04)
