"""Trained 3DGS checkpoints: values that make no sense or are stored otherwise, and what does not belong to it."""

import numpy as np
import plyfile
import pytest

from fracsim.asset import gaussians, ply

from .balls import ball, prepared


def edited(path, **columns):
    """A checkpoint with single values replaced: name=(vertex, value)."""
    ply.write(path, *ball(40))
    file = plyfile.PlyData.read(path)
    vertex = np.array(file["vertex"].data)
    for name, (at, value) in columns.items():
        vertex[name][at] = value
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(path)
    return path


@pytest.mark.parametrize(
    ("name", "value", "word"),
    [("x", np.nan, "position"), ("scale_1", np.inf, "deviation"), ("scale_2", 1e3, "deviation"),
     ("opacity", np.nan, "opacity"), ("rot_2", np.inf, "rotation"), ("f_dc_0", np.nan, "colour")],
)  # fmt: skip
def test_a_row_that_makes_no_sense_is_dropped_and_named(tmp_path, name, value, word):
    read = ply.read(edited(tmp_path / "bad.ply", **{name: (7, value)}))
    assert len(read.means) == 39
    assert f"1 of 40 Gaussians were dropped, their values are no numbers: {word} of vertex 7 is" in read.notes[0]


def test_a_file_of_rows_that_make_no_sense_is_refused(tmp_path):
    path = edited(tmp_path / "bad.ply", x=(slice(30), np.nan))
    with pytest.raises(ValueError, match=r"asset\.path=.*position of vertex 0 is nan.*30 of 40"):
        prepared(path)


def test_infinite_logits_and_logarithms_are_exact_ends(tmp_path):
    """Converters write opaque as +inf, transparent as -inf, and flat as the logarithm of 0."""
    read = ply.read(edited(tmp_path / "ends.ply", opacity=(slice(2), (np.inf, -np.inf)), scale_2=(3, -np.inf)))
    assert read.opacity[:2].tolist() == [1.0, 0.0]
    assert np.linalg.eigvalsh(read.covariance[3])[0] == pytest.approx(0.0, abs=1e-9)
    assert not read.notes


def without(path, *names):
    """The checkpoint without some properties."""
    vertex = plyfile.PlyData.read(path)["vertex"].data
    kept = [n for n in vertex.dtype.names if n not in names]
    vertex = np.array([tuple(row) for row in vertex[kept]], [(n, "f4") for n in kept])
    plyfile.PlyData([plyfile.PlyElement.describe(vertex, "vertex")]).write(path)
    return path


def test_discs_have_two_scales(tmp_path):
    """2DGS files have no scale_2: the Gaussians are flat, and otherwise the same."""
    ply.write(tmp_path / "cloud.ply", *ball(60))
    whole = ply.read(tmp_path / "cloud.ply")
    # What is written has its scales in ascending order: the first axis becomes that which the disc has not.
    vertex = plyfile.PlyData.read(tmp_path / "cloud.ply")
    vertex["vertex"].data["scale_2"] = -np.inf
    vertex.write(tmp_path / "flat.ply")
    flat, discs = ply.read(tmp_path / "flat.ply"), ply.read(without(tmp_path / "cloud.ply", "scale_2"))
    assert np.array_equal(discs.covariance, flat.covariance)
    assert np.allclose(np.linalg.eigvalsh(discs.covariance)[:, :1], 0, atol=1e-9)
    assert len(discs.means) == len(whole.means)


def linear(path, opacities=False, scales=False):
    """The checkpoint with opacities or scales stored as they are."""
    file = plyfile.PlyData.read(path, mmap=False)
    vertex = file["vertex"].data
    if opacities:
        vertex["opacity"] = 1 / (1 + np.exp(-vertex["opacity"]))
    if scales:
        for i in range(3):
            vertex[f"scale_{i}"] = np.exp(vertex[f"scale_{i}"])
    file.write(path)
    return path


@pytest.mark.parametrize("what", ["opacities", "scales"])
def test_values_stored_as_they_are_are_recognised(tmp_path, what):
    """Read as logits no opacity would leave [0.5, 0.73]; read as logarithms every Gaussian would cover the object."""
    ply.write(tmp_path / "ball.ply", *ball(400))
    usual = ply.read(tmp_path / "ball.ply")
    read = ply.read(linear(tmp_path / "ball.ply", **{what: True}))
    assert np.allclose(read.opacity, usual.opacity, atol=1e-6)
    assert np.allclose(read.covariance, usual.covariance, rtol=1e-5, atol=1e-9)
    assert len(read.notes) == 1
    assert "as they are" in read.notes[0] or "as standard deviations" in read.notes[0]


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3, 1e6])
def test_the_unit_of_a_file_does_not_decide_how_it_is_read(tmp_path, size):
    """In millimetres all logarithms of scales may be positive: they are still logarithms."""
    ply.write(tmp_path / "ball.ply", *ball(400, radius=size, centre=(0, 0, 0)))
    assert not ply.read(tmp_path / "ball.ply").notes
    assert ply.read(linear(tmp_path / "ball.ply", scales=True)).notes


def test_half_opaque_gaussians_are_no_linear_ones(tmp_path):
    means, A, _, sh = ball(400)
    ply.write(tmp_path / "ball.ply", means, A, np.linspace(0.5, 0.7, 400), sh)
    read = ply.read(tmp_path / "ball.ply")
    assert np.allclose(read.opacity, np.linspace(0.5, 0.7, 400), atol=1e-6)


def test_colours_in_bytes_stand_for_missing_coefficients(tmp_path):
    ply.write(tmp_path / "ball.ply", *ball(10))
    without(tmp_path / "ball.ply", "f_dc_0", "f_dc_1", "f_dc_2")
    vertex = plyfile.PlyData.read(tmp_path / "ball.ply")["vertex"].data
    kinds = [*vertex.dtype.descr, *((n, "u1") for n in ("red", "green", "blue"))]
    rows = np.array([(*row, 255, 0, 51) for row in vertex], kinds)
    plyfile.PlyData([plyfile.PlyElement.describe(rows, "vertex")]).write(tmp_path / "ball.ply")
    read = ply.read(tmp_path / "ball.ply")
    assert np.allclose(0.5 + gaussians.SH_C0 * read.sh[:, 0], (1, 0, 0.2), atol=1e-6)


def lollipop():
    """A ball and a stick of less than one percent of the Gaussians, that reaches far below it."""
    means, A, opacity, sh = ball(6000, centre=(0, 0, 0), radius=1.0)
    stick = np.stack([np.zeros(50), np.linspace(-1.0, -4.0, 50), np.zeros(50)], axis=1)
    more = [np.repeat(a[:1], 50, axis=0) for a in (A, opacity, sh)]
    joined = [np.concatenate(pair) for pair in zip((A, opacity, sh), more, strict=True)]
    return np.concatenate([means, stick]), *joined


def test_what_is_joined_to_the_object_is_no_floater(tmp_path):
    means, A, opacity, sh = lollipop()
    means = np.concatenate([means, [[3.0, 0, 0], [0, 9.0, 0]]])
    A, opacity, sh = (np.concatenate([a, a[:2]]) for a in (A, opacity, sh))
    ply.write(tmp_path / "pop.ply", means, A, opacity, sh)
    particles = prepared(tmp_path / "pop.ply")
    assert particles.surface.sum() == 6050
    assert np.allclose(np.ptp(particles.X, axis=0), (0.24, 0.6, 0.24), atol=0.005)
    assert any("2 Gaussians float" in note for note in particles.notes)


@pytest.mark.parametrize("many", [1500, 5000])
@pytest.mark.parametrize("far", [5.0, 40.0])
def test_a_background_around_the_object_is_left_out_and_named(tmp_path, many, far):
    parts = [ball(3000, centre=(0, 0, 0), radius=1.0), ball(many, centre=(0.3, 0, 0), radius=far, seed=1)]
    ply.write(tmp_path / "dome.ply", *(np.concatenate(pair) for pair in zip(*parts, strict=True)))
    particles = prepared(tmp_path / "dome.ply")
    assert np.linalg.norm(particles.X - 1, axis=1).max() == pytest.approx(0.3, abs=0.001)
    assert particles.surface.sum() == 3000
    assert any(f"{many} Gaussians" in n and "background" in n and "crop" in n for n in particles.notes)


def test_a_shell_close_around_the_object_belongs_to_it(tmp_path):
    """A snow globe: twice as wide as what it holds."""
    parts = [ball(3000, centre=(0, 0, 0), radius=1.0), ball(3000, centre=(0, 0, 0), radius=2.0)]
    ply.write(tmp_path / "globe.ply", *(np.concatenate(pair) for pair in zip(*parts, strict=True)))
    assert prepared(tmp_path / "globe.ply").surface.sum() == 6000
