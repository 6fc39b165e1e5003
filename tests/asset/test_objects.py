"""The built-in objects: solid, in one piece, near to a true distance, coloured, grippable, the same every time."""

import importlib
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fracsim import registry
from fracsim.asset.procedural import noise, shapes

Array = NDArray[np.floating[Any]]

FOODS = ("bread", "bread_roll", "cake", "croissant", "muffin")
TOYS = ("bear", "duck", "ring", "star", "whale")
EXTENT = 0.6  # largest extent in the scene [m]
THICKNESS = 0.05  # of a grip along the pull axis [m]
PER_EXTENT = 90  # particles along the largest extent


OBJECTS = registry.names("fracsim.asset.objects")


@pytest.fixture(params=OBJECTS)
def solid(request: pytest.FixtureRequest) -> ModuleType:
    return importlib.import_module(f"fracsim.asset.objects.{request.param}")


def name(solid: ModuleType) -> str:
    return solid.__name__.rpartition(".")[2]


def lattice(solid: ModuleType, count: int) -> tuple[Array, float]:
    """Points [n, n, n, 3] at the middles of a cubic lattice round BOUNDS, and its spacing."""
    low, high = np.array(solid.BOUNDS)
    spacing = float((high - low).max() / count)
    line = (np.arange(count) + 0.5) * spacing - count * spacing / 2
    return np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1) + (low + high) / 2, spacing


def filled(solid: ModuleType, count: int) -> tuple[Array, float]:
    """Lattice points inside the solid [N, 3] and the lattice spacing."""
    points, spacing = lattice(solid, count)
    flat = points.reshape(-1, 3)
    return flat[solid.distance(flat) < 0], spacing


def scattered(solid: ModuleType, count: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(*solid.BOUNDS, (count, 3))


def on_surface(solid: ModuleType, count: int) -> Array:
    """Points within 0.002 of the surface."""
    points = scattered(solid, 80 * count, 3)
    return points[np.abs(solid.distance(points)) < 0.002][:count]


def test_the_ten_objects_and_the_bar_are_discovered() -> None:
    """And nothing that is no object: helpers lie in another package."""
    assert set(OBJECTS) >= {*FOODS, *TOYS, "bar"}


def test_class_is_the_material_the_object_is_made_of(solid: ModuleType) -> None:
    assert solid.CLASS in ("low_stretch", "high_stretch")
    assert (solid.CLASS == "low_stretch") == (name(solid) in FOODS) or name(solid) not in (*FOODS, *TOYS)


def test_it_lies_in_its_bounds_with_a_margin(solid: ModuleType) -> None:
    low, high = np.array(solid.BOUNDS)
    t = np.linspace(0, 1, 61)
    for axis in range(3):
        sheet = (
            low
            + (high - low)
            * np.stack([*np.meshgrid(t, t), np.zeros((61, 61))], axis=-1)[..., np.roll(range(3), 1 + axis)]
        )
        for side in (low, high):
            sheet[..., axis] = side[axis]
            assert solid.distance(sheet.reshape(-1, 3)).min() > 0.004


def test_it_is_one_connected_piece(solid: ModuleType) -> None:
    points, _ = lattice(solid, 64)
    inside = np.pad((solid.distance(points.reshape(-1, 3)) < 0).reshape(64, 64, 64), 1)
    reached = np.zeros_like(inside)
    reached[tuple(np.argwhere(inside)[0])] = True
    before = 0
    while before != (before := int(reached.sum())):
        for axis in range(3):
            for step in (-1, 1):
                reached |= np.roll(reached, step, axis) & inside
    assert before == inside.sum()


def test_its_volume_is_moderate(solid: ModuleType) -> None:
    # Cost grows with volume / extent^3; a long loaf of 0.10 to 0.12 is about 80,000 particles at 90 an extent.
    inside, spacing = filled(solid, 64)
    share = len(inside) * spacing**3 / float(np.ptp(inside, axis=0).max() + spacing) ** 3
    low, high = (0.10, 0.125) if name(solid) == "bread" else (0.05, 0.30)
    assert low <= share <= high


def test_there_is_material_at_every_grip(solid: ModuleType) -> None:
    inside, spacing = filled(solid, 64)
    low, high = inside.min(axis=0), inside.max(axis=0)
    metres = EXTENT / float((high - low).max() + spacing)
    placed = (inside - (low + high) / 2) * metres
    particles = (spacing * metres * PER_EXTENT / EXTENT) ** 3  # per lattice point
    for angle in (0,) if name(solid) == "bar" else range(0, 180, 15):
        along = placed[:, :2] @ [np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))]
        for offset in (0.10, 0.15, 0.20, 0.25, -0.10, -0.15, -0.20, -0.25):
            held = np.count_nonzero(np.abs(along - offset) <= THICKNESS / 2) * particles
            assert held >= 150, f"{held:.0f} particles at {offset} along {angle} degrees"


def test_the_distance_is_nearly_lipschitz(solid: ModuleType) -> None:
    rng = np.random.default_rng(1)
    a = scattered(solid, 60_000, 2)
    b = a + rng.normal(size=a.shape) * rng.choice([0.005, 0.05, 0.3], (len(a), 1))
    ratio = np.abs(solid.distance(a) - solid.distance(b)) / np.linalg.norm(a - b, axis=1)
    # A true distance has 1; painted relief (lips, chips, pleats) may exceed it on few pairs and not by much.
    assert np.quantile(ratio, 0.99) < 1.1
    assert ratio.max() < 2.0


def test_the_gradient_near_the_surface_is_about_one(solid: ModuleType) -> None:
    points = scattered(solid, 60_000, 4)
    points = points[np.abs(solid.distance(points)) < 0.02]
    steps = 1e-3 * np.eye(3)
    gradient = np.stack([(solid.distance(points + h) - solid.distance(points - h)) / 2e-3 for h in steps], axis=1)
    size = np.linalg.norm(gradient, axis=1)
    assert np.mean((size >= 0.4) & (size <= 1.3)) > 0.95


def test_colours_are_srgb_at_every_depth(solid: ModuleType) -> None:
    points = scattered(solid, 20_000, 5)
    for depth in (np.zeros(len(points)), np.full(len(points), 0.02), np.full(len(points), 0.2)):
        colour = solid.colour(points, depth)
        assert colour.shape == (len(points), 3)
        assert np.isfinite(colour).all()
        assert colour.min() >= 0
        assert colour.max() <= 1


def test_the_texture_is_rich_outside_and_inside(solid: ModuleType) -> None:
    # Trackers need contrast at 0.01 to 0.05 of the extent: at 0.02 apart a flat coat would give 0.
    rng = np.random.default_rng(6)
    skin, core = on_surface(solid, 3000), scattered(solid, 3000, 7)
    for points, depth in ((skin, 0.0), (core, 0.1)):
        aside = rng.normal(size=points.shape)
        aside *= 0.02 / np.linalg.norm(aside, axis=1, keepdims=True)
        still = np.full(len(points), depth)
        change = np.abs(solid.colour(points + aside, still) - solid.colour(points, still)).max(axis=1)
        assert np.median(change) > 0.012


def test_a_crack_opens_on_what_the_object_is_made_of(solid: ModuleType) -> None:
    skin, core = on_surface(solid, 4000), filled(solid, 48)[0]
    core = core[solid.distance(core) < -0.04]
    outside = solid.colour(skin, np.zeros(len(skin))).mean(axis=0)
    inside = solid.colour(core, -solid.distance(core))
    if name(solid) in FOODS:
        assert np.abs(inside.mean(axis=0) - outside).max() > 0.12
    else:
        # Paint is only skin deep: below it rubber of one colour, within its grain.
        assert inside.std(axis=0).max() < 0.06


def test_bread_is_pale_crumb_inside_a_brown_crust() -> None:
    bread = importlib.import_module("fracsim.asset.objects.bread")
    skin, core = on_surface(bread, 4000), filled(bread, 48)[0]
    crust = bread.colour(skin, np.zeros(len(skin))).mean(axis=0)
    crumb = bread.colour(core, np.full(len(core), 0.06)).mean(axis=0)
    assert crumb.min() > 0.65
    assert crust[0] > crust[1] > crust[2]
    assert crust.mean() < crumb.mean() - 0.25


def test_it_is_the_same_every_time_in_any_order(solid: ModuleType) -> None:
    points = scattered(solid, 40_000, 8)
    depth = np.linspace(0, 0.1, len(points))
    np.random.seed(1)  # the global state must not matter
    d, c = solid.distance(points), solid.colour(points, depth)
    np.random.seed(2)
    assert np.array_equal(d, solid.distance(points))
    assert np.array_equal(c, solid.colour(points, depth))
    order = np.random.default_rng(9).permutation(len(points))
    # The ends of vectorised loops may round differently: 1e-5 is some ten units in the last place.
    assert np.allclose(solid.distance(points[order]), d[order], atol=1e-5)
    close = np.abs(solid.colour(points[order], depth[order]) - c[order]).max(axis=1) < 1e-3
    assert close.mean() > 0.999


def test_no_points_are_no_points(solid: ModuleType) -> None:
    none = np.zeros((0, 3))
    assert solid.distance(none).shape == (0,)
    assert solid.colour(none, np.zeros(0)).shape == (0, 3)


def test_shapes_with_a_closed_form() -> None:
    P = np.array([[0.0, 0, 0], [2.0, 0, 0], [0, 3.0, 0], [0, 0, 1.0]]).T
    assert np.allclose(shapes.sphere(P, (0, 0, 0), 1), [-1, 1, 2, 0])
    assert np.allclose(shapes.capsule(P, (0, 0, 0), (0, 2, 0), 0.5, 0.5), [-0.5, 1.5, 0.5, 0.5])
    assert np.allclose(shapes.box(P, (0, 0, 0), (1, 1, 1), 0.25), [-1, 1, 2, 0])
    assert np.allclose(shapes.torus(P, (0, 0, 0), 2, 2, 0.5), [1.5, -0.5, 0.5, np.sqrt(5) - 0.5])
    assert np.allclose(shapes.cylinder(P, (0, 0, 0), 1, 2, 0), [-1, 1, 1, 0])


def test_an_ellipsoid_is_exact_to_first_order_on_its_surface() -> None:
    radii = np.array([[0.5], [0.2], [0.3]])
    n = np.random.default_rng(10).normal(size=(3, 500))
    surface = radii * n / np.linalg.norm(n, axis=0)
    outward = surface / radii**2
    outward /= np.linalg.norm(outward, axis=0)
    step = 1e-4
    for side in (-step, step):
        # Second order in the step, over the smallest radius of curvature 0.2^2 / 0.5 = 0.08.
        d = shapes.ellipsoid(surface + side * outward, (0, 0, 0), (0.5, 0.2, 0.3))
        assert np.allclose(d, side, atol=step**2 / 0.08 * 4)


def test_a_blend_adds_material_only_where_both_are_near() -> None:
    a, b = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-1, 1, 41))
    blended = shapes.union(a, b, 0.2)
    # The quadratic smooth minimum lies blend / 4 below the minimum where a = b, and on it where |a - b| >= blend.
    assert np.allclose(np.diag(blended), np.diag(a) - 0.05)
    apart = np.abs(a - b) >= 0.2
    assert np.allclose(blended[apart], np.minimum(a, b)[apart])


def test_noise_fills_its_range_and_depends_on_its_seed() -> None:
    P = np.random.default_rng(11).uniform(-3, 3, (3, 50_000))
    first, second = noise.value(P, 5, 1), noise.value(P, 5, 2)
    assert np.abs(first).max() <= 1
    assert abs(first.mean()) < 0.03
    assert 0.3 < first.std() < 0.5
    assert abs(np.corrcoef(first, second)[0, 1]) < 0.05


def test_cells_find_the_nearest_point_within_half_a_cell() -> None:
    # Walking away from a cell's point by less than half a cell can change the distance by no more than the walk.
    P = np.random.default_rng(12).uniform(-1, 1, (3, 20_000))
    near, own = noise.cells(P, 10, 3)
    further, _ = noise.cells(P + np.array([[0.002], [0], [0]]), 10, 3)
    close = near < 0.45
    assert np.abs(further - near)[close].max() <= 0.002 * 10 + 1e-4
    assert own.min() >= 0
    assert own.max() < 1
