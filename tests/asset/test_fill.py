"""Filling: true volumes, even spacing, a smooth outline, for solids whose volume and surface are known."""

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fracsim.asset import fill, gaussians, implicit, place
from fracsim.asset.implicit import Implicit
from fracsim.scene.vocab import Asset

SPACING = 0.02


def sphere(radius=0.2):
    centre = place.HOME + 0.003
    lo, hi = centre - radius, centre + radius
    return Implicit(lambda P: np.linalg.norm(P - centre, axis=1) - radius, lo, hi, 0.2 * SPACING), centre


def box(half):
    half = np.array(half)

    def field(P):
        q = np.abs(P - place.HOME) - half
        return np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0)

    return Implicit(field, place.HOME - half, place.HOME + half, 0.2 * SPACING)


SOLIDS = {"sphere": (sphere()[0], 4 / 3 * np.pi * 0.2**3), "box": (box((0.3, 0.1, 0.05)), 8 * 0.3 * 0.1 * 0.05)}


@pytest.mark.parametrize("name", SOLIDS)
def test_particles_have_the_volume_of_the_solid(name):
    """sum of V_p is the volume, not a count of cells.

    The surface cuts a cell anywhere, so that 4^3 midpoints err by at most half a layer of samples, 1/8 of the cell, at
    random: over n > 1000 boundary cells of a volume of N > 1500 cells by less than n^(1/2) / 8 / N = 0.3 %.
    """
    solid, volume = SOLIDS[name]
    assert fill.fill(solid, SPACING).volume.sum() == pytest.approx(volume, rel=5e-3)


@pytest.mark.parametrize("name", SOLIDS)
def test_a_known_volume_is_met_exactly(name):
    solid, _ = SOLIDS[name]
    known = Implicit(solid.field, *solid.bounds, solid.step)
    known.volume = 0.0123
    assert fill.fill(known, SPACING).volume.sum() == pytest.approx(0.0123, rel=1e-12)


@pytest.mark.parametrize("name", SOLIDS)
def test_particles_are_one_a_lattice_cell_everywhere(name):
    """No two particles nearer than half a spacing, no point of the solid further than 1.1 spacings from one."""
    solid, volume = SOLIDS[name]
    filling = fill.fill(solid, SPACING)
    tree = cKDTree(filling.X)
    assert tree.query(filling.X, k=2)[0][:, 1].min() > 0.5 * SPACING
    lo, hi = solid.bounds
    P = np.random.default_rng(0).uniform(lo, hi, (20_000, 3))
    P = P[solid.field(P) < 0]
    assert tree.query(P)[0].max() < 1.1 * SPACING
    assert filling.volume.min() >= fill.SMALLEST * SPACING**3
    # Surface particles lie at a depth of 1/4 where cells' middles would lie at 1/2: the layers span 1/4 more on each
    # side, which is 40 % more particles for the box, 30 x 10 x 5 spacings large.
    assert 1.0 <= len(filling.X) * SPACING**3 / volume < 30.5 * 10.5 * 5.5 / 1500 * 1.2


def test_the_outline_is_smooth():
    """Surface particles lie at SKIN below the surface, within 5 % of a spacing: no stairs."""
    solid, centre = sphere()
    filling = fill.fill(solid, SPACING)
    r = np.linalg.norm(filling.X - centre, axis=1)
    depth = (0.2 - r) / SPACING
    assert np.abs(depth[filling.surface] - fill.SKIN).max() < 0.05
    # The lattice's depths come from central differences on the grid, second order: (spacing / radius)^2.
    assert depth[~filling.surface].min() > fill.INTERIOR - 0.02
    assert np.allclose(filling.depth, depth * SPACING, atol=0.05 * SPACING)
    outward = (filling.X - centre) / r[:, None]
    assert np.einsum("ij,ij->i", outward, filling.normal)[filling.surface].min() > 0.999


def test_the_interior_is_a_regular_lattice_with_whole_cells():
    filling = fill.fill(box((0.3, 0.1, 0.05)), SPACING)
    inner = filling.X[~filling.surface]
    for k in range(3):
        steps = np.diff(np.unique(inner[:, k].round(9)))
        assert np.allclose(steps, SPACING)
        assert inner[:, k].min() + inner[:, k].max() == pytest.approx(2.0)
    deep = filling.depth > fill.FULL * SPACING
    assert deep.any()
    assert np.allclose(filling.volume[deep], SPACING**3)


def test_surface_gaussians_are_flat_along_the_normal():
    """A = t^2 (I - N N^T) + n^2 N N^T; round inside, and never two standard deviations through the surface."""
    solid, centre = sphere()
    filling = fill.fill(solid, SPACING)
    A = gaussians.covariance(filling, SPACING)
    full = np.empty((len(A), 3, 3))
    for k, (i, j) in enumerate(itertools.combinations_with_replacement(range(3), 2)):
        full[:, i, j] = full[:, j, i] = A[:, k]
    deviations = np.sqrt(np.linalg.eigvalsh(full)) / SPACING
    top = filling.surface
    assert np.allclose(deviations[top], [gaussians.NORMAL, gaussians.TANGENTIAL, gaussians.TANGENTIAL])
    across = np.einsum("ni,nij,nj->n", filling.normal[top], full[top], filling.normal[top])
    assert np.allclose(np.sqrt(across), gaussians.NORMAL * SPACING)
    assert np.allclose(deviations[~top, 0], deviations[~top, 2])
    depth = (0.2 - np.linalg.norm(filling.X - centre, axis=1))[~top] / SPACING
    assert (2 * deviations[~top, 2] < depth + 0.1).all()


def test_a_plate_thinner_than_the_spacing_is_one_layer():
    """0.6 spacings thick: no room for two layers; the samples resolve the thickness to 1/4 spacing."""
    filling = fill.fill(box((0.2, 0.2, 0.006)), SPACING)
    assert np.ptp(filling.X[:, 2]) < 0.6 * SPACING
    assert filling.volume.sum() == pytest.approx(8 * 0.2 * 0.2 * 0.006, rel=0.25 / 0.6)


def test_nothing_in_gives_nothing_out():
    empty = Implicit(lambda P: np.ones(len(P)), place.HOME - 0.1, place.HOME + 0.1, 0.2 * SPACING)
    filling = fill.fill(empty, SPACING)
    assert len(filling.X) == len(filling.volume) == 0


def test_the_bounding_box_is_tight_when_turned():
    """An ellipsoid with half axes a, turned by R, reaches sqrt(sum_j R_ij^2 a_j^2) along axis i."""
    a, R = np.array([0.5, 0.2, 0.1]), place.rotation([20.0, -35.0, 50.0])

    def field(P):
        q = (P @ R) / a
        k0, k1 = np.linalg.norm(q, axis=1), np.linalg.norm(q / a, axis=1)
        return k0 * (k0 - 1) / np.maximum(k1, 1e-9)

    lo, hi = implicit.tight_box(field, -0.6 * np.ones(3), 0.6 * np.ones(3))
    reach = np.sqrt(R**2 @ a**2)
    assert np.allclose(hi, reach, atol=2e-3)
    assert np.allclose(lo, -reach, atol=2e-3)


def test_rotation_is_about_x_then_y_then_z():
    """z-up to y-up by [-90, 0, 0]; and x -> y by 90 degrees about z after everything else."""
    assert np.allclose(place.rotation([-90, 0, 0]) @ (0, 0, 1), (0, 1, 0))
    assert np.allclose(place.rotation([90, 0, 90]) @ (0, 1, 0), (0, 0, 1))
    assert np.allclose(place.rotation([0, 90, 90]) @ (0, 0, 1), (0, 1, 0))


def test_placement_scales_the_largest_extent_and_inverts():
    asset = Asset(size=0.6, rotate_deg=[0, 0, 30])
    placement = place.fit(asset, np.array([0.0, 0, 0]), np.array([3.0, 1, 2]))
    P = np.random.default_rng(1).normal(size=(20, 3))
    assert np.allclose(placement.to_object(placement.to_world(P)), P)
    assert placement.scale == pytest.approx(0.2)
