"""Trained 3DGS checkpoints: the file layout, what is refused, and the particles they become."""

import numpy as np
import plyfile
import pytest

from fracsim.asset import enclose, gaussians, harmonics, limits, place, ply, splat
from fracsim.scene.vocab import Asset

from .balls import SPACING, ball, prepared


@pytest.mark.parametrize("k", [1, 4, 9, 16])
def test_what_is_written_is_read(tmp_path, k):
    """float32 and logarithms: relative errors of a few 1e-7; the file has the names of the INRIA layout in order."""
    means, A, opacity, sh = ball(50, k)
    ply.write(tmp_path / "cloud.ply", means, A, opacity, sh)
    read = ply.read(tmp_path / "cloud.ply")
    assert np.allclose(read.means, means, rtol=1e-6)
    assert np.allclose(ply.triangle(read.covariance), A, atol=1e-5 * np.abs(A).max())
    assert np.allclose(read.opacity, opacity, rtol=1e-6)
    assert np.allclose(read.sh, sh, atol=1e-6)
    names = [p.name for p in plyfile.PlyData.read(tmp_path / "cloud.ply")["vertex"].properties]
    rest = [f"f_rest_{i}" for i in range(3 * (k - 1))]
    assert names == ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rest, "opacity",
                     "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]  # fmt: skip


def test_the_layout_is_that_of_the_original(tmp_path):
    """Written by hand: opacity is a logit, scales are logarithms, rot is w x y z, f_rest goes channel by channel."""
    names = [*"xyz", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(9)), "opacity",
             *(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]  # fmt: skip
    row = [1, 2, 3, 0.1, 0.2, 0.3, *range(9), 0.0, *np.log([3.0, 2.0, 1.0]), 2 * np.sqrt(0.5), 0, 0, 2 * np.sqrt(0.5)]
    vertex = np.array([tuple(row)], [(n, "f4") for n in names])
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(tmp_path / "one.ply")
    one = ply.read(tmp_path / "one.ply")
    # A quarter turn about z takes the axis of scale 3 from x to y.
    assert np.allclose(one.covariance[0], np.diag([4, 9, 1]), atol=1e-5)
    assert one.opacity[0] == pytest.approx(0.5)
    assert np.allclose(one.sh[0, 1:], np.arange(9).reshape(3, 3).T)


def test_opacities_of_zero_and_one_can_be_written(tmp_path):
    means, A, _, sh = ball(4)
    ply.write(tmp_path / "cloud.ply", means, A, np.array([0.0, 1.0, 0.5, 0.2]), sh)
    assert np.allclose(ply.read(tmp_path / "cloud.ply").opacity, [0, 1, 0.5, 0.2], atol=2e-6)


def test_a_ball_of_gaussians_becomes_a_full_ball(tmp_path):
    """Shell cells count half, so the volume is right to the share of cells whose touch no Gaussian shows: 5 %."""
    ply.write(tmp_path / "ball.ply", *ball())
    particles = prepared(tmp_path / "ball.ply")
    assert particles.surface.sum() == 6000
    assert particles.volume.sum() == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.05)
    assert np.allclose((particles.X.min(0) + particles.X.max(0)) / 2, 1.0, atol=1e-3)
    r = np.linalg.norm(particles.X - 1, axis=1)
    assert np.allclose(r[particles.surface], 0.3, atol=1e-3)
    inner = ~particles.surface
    # Lattice points throughout the inside: their number is the volume less the outermost half to one spacing.
    assert inner.sum() * SPACING**3 == pytest.approx(4 / 3 * np.pi * (0.3 - 0.75 * SPACING) ** 3, rel=0.1)
    assert r[inner].max() < 0.3 - 0.4 * SPACING
    # Gaussians that share a cell share its volume: equal parts, none below the floor.
    assert particles.volume.min() > 0.5 * splat.LEAST * SPACING**3


def test_trained_gaussians_keep_shape_and_colour(tmp_path):
    means, A, opacity, sh = ball(k=4)
    ply.write(tmp_path / "ball.ply", means, A, opacity, sh)
    particles = prepared(tmp_path / "ball.ply")
    scale = 0.6 / np.ptp(means, axis=0).max()
    top = particles.surface
    assert np.allclose(particles.covariance[top], scale**2 * A, atol=1e-4 * scale**2 * np.abs(A).max())
    assert np.allclose(particles.sh[top], sh, atol=1e-5)
    assert np.allclose(particles.opacity[top], opacity, atol=1e-5)
    assert not particles.sh[~top, 1:].any()
    # The inside below the surface has the colour of the surface there.
    r, y = np.linalg.norm(particles.X - 1, axis=1), particles.X[:, 1] - 1
    rgb = 0.5 + gaussians.SH_C0 * particles.sh[:, 0]
    below = ~top & (r > 0.3 - 1.2 * SPACING)
    assert np.allclose(np.median(rgb[below & (y > 0.05)], axis=0), (0.9, 0.1, 0.1), atol=0.1)
    assert np.allclose(np.median(rgb[below & (y < -0.05)], axis=0), (0.1, 0.1, 0.9), atol=0.1)


def test_faint_and_stray_gaussians_are_dropped(tmp_path):
    means, A, opacity, sh = ball()
    means[:3] += 50.0
    opacity[10:30] = 0.01
    ply.write(tmp_path / "ball.ply", means, A, opacity, sh)
    particles = prepared(tmp_path / "ball.ply")
    assert particles.surface.sum() == 6000 - 3 - 20
    assert any("20 of 6000" in note for note in particles.notes)
    assert any("3 Gaussians float" in note for note in particles.notes)
    assert np.linalg.norm(particles.X - 1, axis=1).max() < 0.31


def test_gaussians_longer_than_a_cell_and_a_half_are_shortened(tmp_path):
    means, A, opacity, sh = ball()
    A[0] *= 400.0
    ply.write(tmp_path / "ball.ply", means, A, opacity, sh)
    particles = prepared(tmp_path / "ball.ply")
    deviation = np.sqrt(np.linalg.eigvalsh(ply.symmetric(particles.covariance.astype(float)))[:, 2])
    assert deviation.max() <= splat.LONGEST * SPACING * 1.001
    assert any("1 Gaussians were shortened" in note for note in particles.notes)


def test_gaps_in_the_shell_are_closed(tmp_path):
    """A hole of three spacings across does not let the outside in."""
    means, A, opacity, sh = ball(centre=(0, 0, 0))
    keep = np.linalg.norm(means - (0, 0, 1.5), axis=1) > 1.5 * SPACING * 1.5 / 0.3
    ply.write(tmp_path / "ball.ply", means[keep], A[keep], opacity[keep], sh[keep])
    particles = prepared(tmp_path / "ball.ply")
    assert particles.volume.sum() == pytest.approx(4 / 3 * np.pi * 0.3**3, rel=0.06)
    assert any("Gaps" in note for note in particles.notes)


def test_turning_a_checkpoint_turns_its_colours(tmp_path):
    """f'(d) = f(R^T d): seen along a direction that turned with the object the colour is as before."""
    ply.write(tmp_path / "ball.ply", *ball(k=16))
    asis, turned = (prepared(tmp_path / "ball.ply", rotate_deg=r) for r in ([0.0] * 3, [30.0, -50.0, 200.0]))
    R = place.rotation([30.0, -50.0, 200.0])
    assert np.allclose((turned.X[:6000] - 1) @ R, asis.X[:6000] - 1, atol=2e-3)
    d = np.random.default_rng(3).normal(size=(6000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    before = np.einsum("nk,nkc->nc", harmonics.basis(d), asis.sh[:6000])
    after = np.einsum("nk,nkc->nc", harmonics.basis(d @ R.T), turned.sh[:6000])
    assert np.allclose(after, before, atol=1e-5)


def test_the_harmonics_are_orthonormal():
    """The integral of Y_i Y_j over the sphere is delta_ij, by Gauss-Legendre in z and equal steps in azimuth."""
    z, w = np.polynomial.legendre.leggauss(8)
    angle = 2 * np.pi * np.arange(16) / 16
    Z, T = (a.ravel() for a in np.meshgrid(z, angle, indexing="ij"))
    Y = harmonics.basis(np.stack([np.sqrt(1 - Z**2) * np.cos(T), np.sqrt(1 - Z**2) * np.sin(T), Z], axis=1))
    weight = np.repeat(w, 16) * 2 * np.pi / 16
    assert np.allclose(Y.T @ (weight[:, None] * Y), np.eye(16), atol=1e-12)


def test_cells_share_their_volume():
    """Two in a cell have half each, an empty cell goes to the nearest, shell cells count half."""
    axes = [np.arange(5.0)] * 3
    inside = np.zeros((5, 5, 5), bool)
    inside[1:4, 2, 2] = True
    body = enclose.Body(inside, np.zeros_like(inside), np.zeros(inside.shape), 0)
    X = np.array([[1.0, 2, 2], [1.2, 2, 2], [2.1, 2, 2]])
    assert np.allclose(body.volumes(X, axes, 0.02), [0.5, 0.5, 2.0])


def test_a_mesh_is_not_a_checkpoint(tmp_path):
    vertex = np.zeros(3, [(n, "f4") for n in "xyz"])
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(tmp_path / "mesh.ply")
    with pytest.raises(ValueError, match=r"asset\.path=.*lacks the properties f_dc_0.*rot_3.*asset\.kind=mesh"):
        prepared(tmp_path / "mesh.ply")


@pytest.mark.parametrize("content", [b"", b"not a ply", b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "other.ply").write_bytes(content)
    with pytest.raises(ValueError, match=r"asset\.path=.*other\.ply.*point_cloud\.ply"):
        prepared(tmp_path / "other.ply")


def test_a_cut_off_file_is_refused(tmp_path):
    ply.write(tmp_path / "whole.ply", *ball(40))
    (tmp_path / "half.ply").write_bytes((tmp_path / "whole.ply").read_bytes()[:-200])
    with pytest.raises(ValueError, match=r"asset\.path=.*half\.ply cannot be read"):
        prepared(tmp_path / "half.ply")


def test_a_wrong_number_of_coefficients_is_named(tmp_path):
    ply.write(tmp_path / "odd.ply", *ball(40, k=3))
    with pytest.raises(ValueError, match=r"6 properties f_rest_\*.*0, 9, 24 or 45"):
        prepared(tmp_path / "odd.ply")


def test_a_threshold_that_drops_all_is_named(tmp_path):
    ply.write(tmp_path / "ball.ply", *ball(40))
    with pytest.raises(ValueError, match=r"asset\.opacity_threshold=1 .*set it below 0\.9"):
        prepared(tmp_path / "ball.ply", opacity_threshold=1.0)


def test_too_many_gaussians_are_refused_by_the_header(tmp_path):
    """The file ends after its header: nothing else is read. Fewer cells would not help, and are not proposed."""
    header = "ply\nformat binary_little_endian 1.0\ncomment x\nelement vertex 4000000\nproperty float x\nend_header\n"
    (tmp_path / "huge.ply").write_bytes(header.encode())
    with pytest.raises(ValueError, match=r"asset\.max_particles=3000000 .*has 4000000 Gaussians") as error:
        limits.check(Asset(kind="ply", path=str(tmp_path / "huge.ply")), SPACING)
    assert "asset.max_particles=8000000" in str(error.value)
    assert "lower solver.cells" not in str(error.value)
