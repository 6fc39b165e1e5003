"""From an asset to particles: size and place, limits, errors that name the way out."""

import subprocess
import sys

import numpy as np
import pytest

from fracsim.asset import builtin
from fracsim.asset.build import build
from fracsim.scene.vocab import CENTRE, Asset

SPACING = 1 / 60


@pytest.fixture(autouse=True)
def _cache(tmp_path, monkeypatch):
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "cache"))


class Ellipsoid:
    """A stand-in for a module of fracsim.asset.objects: half axes 2, 1, 0.5; blue skin 0.05 deep, yellow inside."""

    BOUNDS = ((-2.5, -2.5, -2.5), (2.5, 2.5, 2.5))
    CLASS = "low_stretch"
    HALF = np.array([2.0, 1.0, 0.5])

    @classmethod
    def distance(cls, P):
        k0, k1 = np.linalg.norm(P / cls.HALF, axis=1), np.linalg.norm(P / cls.HALF**2, axis=1)
        return np.where(k0 < 1e-3, -0.5, k0 * (k0 - 1) / np.maximum(k1, 1e-6))

    @staticmethod
    def colour(P, depth):
        return np.where(depth[:, None] < 0.05, (0.1, 0.2, 0.9), (0.9, 0.8, 0.1))


@pytest.mark.parametrize("rotate", [[0.0, 0.0, 0.0], [0.0, 0.0, 90.0], [20.0, 30.0, 40.0]])
def test_size_place_and_volume(rotate):
    """The largest extent is asset.size and the middle of the box is CENTRE, also when turned.

    Half extents of the turned ellipsoid are sqrt(R^2 a^2) by rows; surface particles lie 1/4 spacing below them.
    """
    from fracsim.asset.place import rotation

    particles = builtin.of_module(Ellipsoid, Asset(size=0.9, rotate_deg=rotate), SPACING)
    half = np.sqrt(rotation(rotate) ** 2 @ Ellipsoid.HALF**2)
    scale = 0.9 / (2 * half.max())
    expected = 2 * scale * half - 0.5 * SPACING
    assert np.allclose(np.ptp(particles.X, axis=0), expected, atol=0.2 * SPACING)
    assert np.allclose((particles.X.min(0) + particles.X.max(0)) / 2, CENTRE, atol=0.1 * SPACING)
    assert particles.volume.sum() == pytest.approx(4 / 3 * np.pi * np.prod(scale * Ellipsoid.HALF), rel=0.01)


def test_colours_come_at_the_depth_of_the_particle():
    """Depths are in units of the object: the skin is 0.05 of 4, at size 0.8 that is 0.01 m deep."""
    particles = builtin.of_module(Ellipsoid, Asset(size=0.8), SPACING)
    rgb = 0.5 + 0.28209479177387814 * particles.sh[:, 0]
    assert np.allclose(rgb[particles.surface], (0.1, 0.2, 0.9), atol=1e-5)
    middle = np.linalg.norm(particles.X - 1, axis=1) < 0.05
    assert np.allclose(rgb[middle], (0.9, 0.8, 0.1), atol=1e-5)


def test_the_default_object_is_whole():
    asset = Asset(name="bar", size=0.6)
    particles = build(asset, SPACING, 0)
    assert np.isfinite(particles.X).all()
    assert np.isfinite(particles.covariance).all()
    assert (particles.volume > 0).all()
    assert 0.05 < particles.surface.mean() < 0.95
    assert particles.spacing == SPACING
    assert particles.X.dtype == particles.sh.dtype == np.float32
    again = builtin.prepare(asset, SPACING, 0)
    assert np.array_equal(again.X, particles.X)


def test_too_many_particles_are_refused_before_filling(monkeypatch):
    monkeypatch.setattr("fracsim.asset.fill.fill", lambda *_: pytest.fail("filled before the estimate"))
    with pytest.raises(ValueError, match=r"asset\.max_particles=100 .*about \d+ particles.*solver\.cells.*asset\.size"):
        build(Asset(name="bar", max_particles=100), SPACING, 0)


def test_a_cached_object_is_counted_too():
    build(Asset(name="bar"), SPACING, 0)
    with pytest.raises(ValueError, match=r"asset\.max_particles=100 .*solver\.cells"):
        build(Asset(name="bar", max_particles=100), SPACING, 0)


def test_too_fine_a_grid_is_refused():
    with pytest.raises(ValueError, match=r"asset\.size=1\.6 .*grid of .*lower asset\.size or solver\.cells"):
        build(Asset(name="bar", size=1.6, max_particles=10**12), 1 / 2000, 0)


def test_too_few_particles_are_refused():
    with pytest.raises(ValueError, match=r"asset\.size=0\.01 gives \d particles.*at least 8.*solver\.cells"):
        build(Asset(name="bar", size=0.01), 0.02, 0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"kind": "mesh", "path": "nowhere.glb"}, r"asset\.path=nowhere\.glb is not a file"),
        ({"kind": "mesh", "path": "thing.fbx"}, r"asset\.path=thing\.fbx .*\.glb"),
        ({"kind": "ply", "path": "cloud.glb"}, r"asset\.path=cloud\.glb .*\.ply"),
        ({"rotate_deg": [90.0]}, r"asset\.rotate_deg=\[90\.0\] must have three angles"),
        ({"kind": "mesh", "path": "a.obj", "interior": "blue"}, r"asset\.interior=blue is not a colour"),
    ],
)
def test_bad_fields_are_named(fields, message):
    with pytest.raises(ValueError, match=message):
        build(Asset(**fields), SPACING, 0)


def test_a_huge_file_is_refused_unread(tmp_path):
    huge = tmp_path / "huge.stl"
    with huge.open("wb") as file:
        file.truncate(3 << 30)  # sparse: takes no disk
    with pytest.raises(ValueError, match=r"asset\.path=.*huge\.stl has 3\.0 GiB.*decimate"):
        build(Asset(kind="mesh", path=str(huge)), SPACING, 0)


def test_a_missing_spacing_is_named():
    with pytest.raises(ValueError, match=r"spacing=0 must be > 0"):
        build(Asset(name="bar"), 0, 0)


def test_importing_build_is_light():
    """Neither SciPy nor trimesh nor Taichi is loaded until an object must be made."""
    heavy = ("scipy", "trimesh", "plyfile", "PIL", "taichi")
    code = f"import sys, fracsim.asset.build; print([m for m in {heavy} if m in sys.modules])"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert shown.strip() == "[]"
