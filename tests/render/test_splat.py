"""Projection and compositing against the NumPy oracle, and what follows from the compositing equation alone."""

import numpy as np
import pytest
import taichi as ti

from fracsim.camera import NEAR, framing, look_at, project
from fracsim.render.composite import compositor
from fracsim.render.project import projector
from fracsim.render.splat import TILT, Splatter, visibility
from tests.reference import splat_numpy as oracle

VIEW = look_at(np.array([1.9, 1.6, 2.4]), np.ones(3), np.array([0.0, 1, 0]), 130, 150, 60, 42, 112, 96)
FRONT = framing(np.ones(3), 0.5, 0.5, 40, 0, 0, 64, 64)


def random_scene(n, channels, dtype, seed):
    """Gaussians in, beside and behind the picture, round to needle-like, invisible to opaque."""
    rng = np.random.default_rng(seed)
    means = np.ones(3) + rng.normal(size=(n, 3)) * 0.5
    means[: n // 20] = VIEW.eye + rng.normal(size=(n // 20, 3)) * 0.3  # some before the near plane, or behind
    half = rng.normal(size=(n, 3, 3)) * rng.uniform(0.003, 0.06, (n, 1, 1))
    A = half @ half.transpose(0, 2, 1)
    covariance = A.reshape(n, 9)[:, [0, 1, 2, 4, 5, 8]]
    F = np.eye(3) + 0.4 * rng.normal(size=(n, 3, 3))
    opacity = rng.uniform(0, 1, n)
    features = rng.uniform(-1, 1, (n, channels))
    return tuple(np.ascontiguousarray(a, dtype) for a in (means, covariance, F, opacity, features))


def blob(positions, sigma, opacity, features):
    """Round, undeformed Gaussians."""
    n = len(positions)
    covariance = np.zeros((n, 6))
    covariance[:, [0, 3, 5]] = sigma**2
    return np.asarray(positions), covariance, np.tile(np.eye(3), (n, 1, 1)), np.full(n, opacity), features


def doubles(scene):
    return [a.astype(np.float64) for a in scene]


def test_projection_equals_the_oracle():
    means, covariance, F, opacity, _ = random_scene(400, 1, np.float64, 1)
    (depth, key), rectangle, ellipse = np.empty((2, 400)), np.empty((400, 4), np.int32), np.empty((400, 8))
    size = VIEW.width, VIEW.height
    projector(ti.f64)(means, covariance, F, opacity, VIEW.rotation, VIEW.world_to_camera[:3, 3], (VIEW.fx, VIEW.fy),
                      (VIEW.cx, VIEW.cy), size, VIEW.near, TILT, depth, key, rectangle, ellipse)  # fmt: skip
    z, centre, flat = oracle.project(VIEW, means, covariance, F)
    seen = depth > 0
    assert 100 < seen.sum() < 400
    assert (z[seen] > VIEW.near).all()
    beyond = np.abs(centre[seen] / size - 0.5).max(axis=1) > 0.65
    assert beyond.sum() > 5  # where the Jacobian is held
    np.testing.assert_allclose(depth[seen], z[seen], rtol=1e-12)
    tilted = VIEW.rotation[2] + TILT[0] * VIEW.rotation[0] + TILT[1] * VIEW.rotation[1]
    np.testing.assert_allclose(key[seen], (means[seen] - VIEW.eye) @ tilted, rtol=1e-12)
    np.testing.assert_allclose(ellipse[seen, :2], centre[seen], atol=1e-9)
    inverse = np.linalg.inv(flat[seen])
    conic = -np.stack([inverse[:, 0, 0] / 2, inverse[:, 0, 1], inverse[:, 1, 1] / 2], axis=1)
    np.testing.assert_allclose(ellipse[seen, 2:5], conic, rtol=1e-6, atol=1e-9)
    # The box of the ellipse where alpha is 1/255; what lies wholly outside the picture is left out.
    half = np.sqrt(2 * np.log(255 * opacity[seen, None]) * np.diagonal(flat[seen], axis1=1, axis2=2))
    np.testing.assert_allclose(ellipse[seen, 6:], half, rtol=1e-6)
    xy, _ = project(VIEW, means[seen])
    np.testing.assert_allclose(ellipse[seen, :2], xy, atol=1e-9)


@pytest.mark.parametrize("tilt", [(0, 0), TILT])
@pytest.mark.parametrize("channels", [3, 8, 9])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-5), (np.float32, 2e-3)])
def test_render_equals_the_oracle(channels, dtype, tolerance, tilt):
    """Tolerances of the specification: rounding gives 1e-5 in float32, and where it carries one Gaussian over the
    alpha floor 1/255. In this scene no alpha is that near: |255 alpha - 1| > 5e-5 wherever it would show.
    """
    scene = random_scene(400, channels, dtype, 4)
    image, alpha, median = Splatter(VIEW, channels, dtype, tilt).render(*scene)
    expected = oracle.render(VIEW, *doubles(scene), tilt)
    assert expected[1].max() > 0.999
    assert expected[1].min() < 0.5
    np.testing.assert_allclose(image, expected[0], atol=tolerance)
    np.testing.assert_allclose(alpha, expected[1], atol=tolerance)
    np.testing.assert_allclose(median, expected[2], atol=tolerance)


def test_a_pixel_a_thread_equals_a_tile_a_thread():
    """The two ways of sharing out the work, for GPUs and CPUs, add in the same order: equal bit for bit."""
    scene = random_scene(300, 4, np.float32, 3)
    splatter = Splatter(VIEW, 4)
    tile_wise = splatter.render(*scene)
    splatter._composite = compositor(4, 1, ti.f32)
    for a, b in zip(tile_wise, splatter.render(*scene), strict=True):
        np.testing.assert_array_equal(a, b)


def test_weights_add_up_to_alpha():
    """sum alpha_i prod (1 - alpha_j) telescopes to 1 - T: a feature of one composites to the alpha map."""
    *scene, _ = random_scene(400, 1, np.float64, 4)
    image, alpha, _ = Splatter(VIEW, 1, np.float64).render(*scene, np.ones((400, 1)))
    np.testing.assert_allclose(image[..., 0], alpha, atol=1e-12)


def test_maps_have_the_support_of_rgb():
    """One pass, one set of weights: what is not in RGB's alpha is in no map, and the other way round."""
    scene = random_scene(60, 8, np.float32, 5)
    scene[4][:] = np.abs(scene[4]) + 0.1
    image, alpha, _ = Splatter(VIEW, 8).render(*scene)
    assert 0.1 < (alpha > 0).mean() < 0.9
    np.testing.assert_array_equal(image > 0, np.broadcast_to((alpha > 0)[..., None], image.shape))
    only, alpha_only, _ = Splatter(VIEW, 3).render(*scene[:4], scene[4][:, :3])
    np.testing.assert_array_equal(image[..., :3], only)
    np.testing.assert_array_equal(alpha, alpha_only)


def test_order_in_memory_does_not_matter():
    scene = random_scene(300, 3, np.float32, 6)
    shuffle = np.random.default_rng(0).permutation(300)
    splatter = Splatter(VIEW, 3)
    for a, b in zip(splatter.render(*scene), splatter.render(*(s[shuffle] for s in scene)), strict=True):
        np.testing.assert_array_equal(a, b)


def bar(turn_deg):
    """Three layers of a lattice of 10 mm, turned about z, every Gaussian of another colour: positions and the rest."""
    spacing, turn = 0.01, np.radians(turn_deg)
    P = np.stack(np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in (30, 20, 3)), indexing="ij"), -1).reshape(-1, 3)
    R = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    colours = np.random.default_rng(0).random((len(P), 3))
    return blob(1 + spacing * P @ R.T, 0.6 * spacing, 0.98, colours)


def shimmer(scene, view, tilt):
    """Largest change of a picture [levels of 255] by normal noise of a micrometre, over four draws."""
    rng, splatter = np.random.default_rng(1), Splatter(view, 3, np.float32, tilt)
    pictures = [splatter.render(scene[0] + 1e-6 * rng.normal(size=scene[0].shape), *scene[1:])[0] for _ in range(4)]
    return 255 * np.abs(np.array(pictures) - splatter.render(*scene)[0]).max()


@pytest.mark.parametrize("turn", [0, 15, 30, 45, 60, 82.5])
@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (90, 0), (180, 0), (0, 89.999)])
def test_a_micrometre_does_not_change_a_face_seen_face_on(turn, azimuth, elevation):
    """A micrometre is 2e-3 pixels here, and moves alpha and T by less than a level; so does the order of Gaussians."""
    view = framing(np.ones(3), 0.17, 0.17, 40, azimuth, elevation, 96, 96)
    assert shimmer(bar(turn), view, TILT) < 2


def test_sorted_by_depth_a_face_would_shimmer():
    """So the test above can fail: in the order of round-off a picture changes by tens of levels."""
    assert shimmer(bar(0), framing(np.ones(3), 0.17, 0.17, 40, 0, 0, 96, 96), (0, 0)) > 19


def test_order_in_memory_does_not_matter_among_equal_depths():
    scene = bar(0)
    shuffle = np.random.default_rng(0).permutation(len(scene[0]))
    splatter = Splatter(FRONT, 3)
    for a, b in zip(splatter.render(*scene), splatter.render(*(s[shuffle] for s in scene)), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("column", "row"), [(0, 0), (63, 0), (0, 63), (63, 63), (31, 31)])
def test_on_a_ray_the_nearer_one_comes_first_at_any_angle_of_view(column, row):
    """Two small opaque Gaussians on the ray of a pixel, a millimetre apart, in a view of 150 degrees."""
    view = framing(np.ones(3), 0.5, 0.5, 150, 0, 0, 64, 64)
    ray = np.array([(column + 0.5 - 32) / view.fx, (row + 0.5 - 32) / view.fy, 1])
    points = view.eye + np.array([[0.2], [0.201]]) * (ray @ view.rotation)
    for order in ([0, 1], [1, 0]):
        image, _, _ = Splatter(view, 2, np.float64).render(*blob(points[order], 1e-4, 1.0, np.eye(2)[order]))
        np.testing.assert_allclose(image[row, column], [0.99, 0.0099], rtol=1e-6)


def test_buffers_carry_nothing_from_frame_to_frame():
    large, small = random_scene(500, 3, np.float32, 7), random_scene(40, 3, np.float32, 8)
    splatter, fresh = Splatter(VIEW, 3), Splatter(VIEW, 3)
    first = splatter.render(*large)
    kept = [a.copy() for a in first]
    for a, b in zip(splatter.render(*small), fresh.render(*small), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(first, kept, strict=True):
        np.testing.assert_array_equal(a, b)


def test_deformation_shows_as_F_A_Ft():
    """A rest covariance A seen through F, and F A F^T seen through the identity, are one picture."""
    means, covariance, F, opacity, features = random_scene(200, 3, np.float64, 9)
    deformed = (F @ oracle.symmetric(covariance) @ F.transpose(0, 2, 1)).reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]]
    splatter = Splatter(VIEW, 3, np.float64)
    one = splatter.render(means, covariance, F, opacity, features)
    other = splatter.render(means, deformed, np.tile(np.eye(3), (200, 1, 1)), opacity, features)
    np.testing.assert_allclose(one[0], other[0], atol=1e-9)


def test_no_gaussians_is_an_empty_picture():
    image, alpha, median = Splatter(FRONT, 2).render(*blob(np.zeros((0, 3)), 0.1, 0.9, np.zeros((0, 2))))
    assert image.shape == (64, 64, 2)
    assert not image.any()
    assert not alpha.any()
    assert np.isinf(median).all()
    behind = blob([FRONT.eye + [0, 0, 1]], 0.1, 0.9, np.ones((1, 2)))
    assert not Splatter(FRONT, 2).render(*behind)[1].any()


@pytest.mark.parametrize("size", [0.01, 1.0])
def test_a_gaussian_is_drawn_behind_the_near_plane_only(size):
    """At a distance D the near plane is NEAR D before the eye, whatever the size of the scene."""
    view = framing(np.ones(3), size, size, 40, 0, 0, 64, 64)
    np.testing.assert_allclose(view.near, NEAR * size / np.tan(np.radians(20)), rtol=1e-12)
    for depth, drawn in ((1.001 * view.near, True), (0.999 * view.near, False)):
        scene = blob([view.eye - [0, 0, depth]], 0.1 * view.near, 0.9, np.ones((1, 1)))
        assert Splatter(view, 1, np.float64).render(*scene)[1].any() == drawn


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_degenerate_gaussians_are_left_out(dtype):
    """NaN and infinity anywhere, negative determinants and opacities: the sound Gaussian is seen as if alone."""
    good = blob(np.ones((9, 3)), 0.05, 0.9, np.ones((9, 1)))
    means, covariance, F, opacity, features = (a.copy() for a in good)
    means[1, 0], covariance[2, 3], F[3, 1, 2], opacity[4] = np.nan, np.nan, np.nan, np.nan
    covariance[5, 0], covariance[6], opacity[7], opacity[8] = np.inf, -1, -0.5, 0.003
    splatter = Splatter(FRONT, 1, dtype)
    alone = splatter.render(*(a[:1] for a in good))
    for a, b in zip(splatter.render(means, covariance, F, opacity, features), alone, strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_huge_gaussian_fills_the_picture_and_no_more():
    scene = blob(np.ones((1, 3)), 2e7, 0.7, np.ones((1, 1)))
    _, alpha, median = Splatter(FRONT, 1).render(*scene)
    np.testing.assert_allclose(alpha, 0.7, rtol=1e-5)
    np.testing.assert_allclose(median, FRONT.eye[2] - 1, rtol=1e-6)


def test_alpha_is_capped():
    _, alpha, _ = Splatter(FRONT, 1).render(*blob(np.ones((1, 3)), 1.0, 1.0, np.ones((1, 1))))
    np.testing.assert_allclose(alpha.max(), 0.99, rtol=1e-6)


def test_a_pixel_is_done_before_its_transmittance_falls_below_1e_4():
    """Layers of alpha 0.8 leave T = 0.2^k; the sixth would leave 6.4e-5, so five count, and the pixel is done."""
    layers = np.array([[1.0, 1, 1.1 - 0.01 * k] for k in range(9)])
    image, alpha, median = Splatter(FRONT, 9, np.float64).render(*blob(layers, 1e4, 0.8, np.eye(9)))
    k = np.arange(9)
    np.testing.assert_allclose(image[40, 7], np.where(k < 5, 0.8 * 0.2**k, 0), atol=1e-6)
    np.testing.assert_allclose(1 - alpha, 0.2**5, atol=1e-6)
    np.testing.assert_allclose(median, FRONT.eye[2] - 1.1, rtol=1e-9)


def test_a_point_is_seen_unless_half_the_light_is_lost_before_it():
    wall = blob(np.ones((1, 3)), 0.3, 0.9, np.ones((1, 1)))
    _, _, median = Splatter(FRONT, 1).render(*wall)
    points = np.ones(3) + np.array([[0, 0, 0.1], [0, 0, 0], [0, 0, -0.1], [0.9, 0, 0], [0, 0, 9], [0.49, 0.49, -0.1]])
    np.testing.assert_array_equal(visibility(FRONT, median, points, 0.01), [True, True, False, False, False, True])
    assert visibility(FRONT, median, points, 0.2)[2]


@pytest.mark.parametrize("name", ["means", "covariance", "F", "opacity", "features"])
def test_wrong_shapes_are_named(name):
    names = "means", "covariance", "F", "opacity", "features"
    scene = dict(zip(names, blob(np.ones((2, 3)), 0.1, 1, np.ones((2, 3))), strict=True))
    scene[name] = scene[name][..., None]
    with pytest.raises(ValueError, match=f"splat: {name} has shape"):
        Splatter(FRONT, 3).render(**scene)
