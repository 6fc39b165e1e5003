"""The camera's conventions, by points whose place in the picture is known."""

import numpy as np
import pytest

from fracsim import Asset, Camera, Capture, Loading, Scene
from fracsim.camera import CLEAR, NEAR, View, framing, look_at, project, view_of

CENTRE = np.array([1.0, 1.0, 1.0])


def middle_to(view, offset):
    """How far in the picture [px] a point at CENTRE + offset lies from CENTRE."""
    xy, _ = project(view, CENTRE + np.array([[0, 0, 0], offset]))
    return xy[1] - xy[0]


def test_default_front_view_looks_along_minus_z_with_y_up():
    view = framing(CENTRE, 0.3, 0.3, 40, 0, 0, 512, 512)
    xy, depth = project(view, CENTRE[None])
    np.testing.assert_allclose(xy, [[256, 256]], atol=1e-9)
    np.testing.assert_allclose(view.eye, CENTRE + [0, 0, depth[0]], atol=1e-12)
    right, up = middle_to(view, [0.1, 0, 0]), middle_to(view, [0, 0.1, 0])
    assert right[0] > 0
    assert up[1] < 0  # rows count downwards
    np.testing.assert_allclose([right[1], up[0]], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("azimuth", "elevation", "towards_eye"),
    [(90, 0, [1, 0, 0]), (-90, 0, [-1, 0, 0]), (180, 0, [0, 0, -1]), (0, 90, [0, 1, 0]), (0, -90, [0, -1, 0])],
)
def test_orbit_angles_move_the_eye(azimuth, elevation, towards_eye):
    """Azimuth counter-clockwise seen from above (from +z to +x), elevation upwards; straight above works too."""
    view = framing(CENTRE, 0.3, 0.3, 40, azimuth, elevation, 512, 512)
    direction = view.eye - CENTRE
    np.testing.assert_allclose(direction / np.linalg.norm(direction), towards_eye, atol=1e-12)


@pytest.mark.parametrize(("half_width", "half_height"), [(0.6, 0.2), (0.2, 0.6)])
@pytest.mark.parametrize(("width", "height"), [(512, 256), (256, 512)])
def test_framing_just_holds_the_rectangle(half_width, half_height, width, height):
    view = framing(CENTRE, half_width, half_height, 35, 30, 20, width, height)
    right, down = view.rotation[0], view.rotation[1]
    corners = CENTRE + np.array([a * half_width * right + b * half_height * down for a in (-1, 1) for b in (-1, 1)])
    xy, _ = project(view, corners)
    reach = np.abs(xy - [width / 2, height / 2]).max(axis=0) / [width / 2, height / 2]
    np.testing.assert_allclose(reach.max(), 1, atol=1e-9)  # one side touches the border, the other lies inside


def test_field_of_view_is_vertical():
    view = framing(CENTRE, 0.3, 0.3, 90, 0, 0, 512, 256)
    np.testing.assert_allclose((view.fx, view.fy), 128)  # 45 degrees from the middle to the upper border


def test_explicit_matrix_gives_the_eye_and_rejects_what_is_not_rigid():
    view = look_at(np.array([3.0, 2, 1]), CENTRE, np.array([0.0, 0, 1]), 300, 310, 100, 90, 208, 192)
    again = View(view.world_to_camera, 300, 310, 100, 90, 208, 192)
    np.testing.assert_allclose(again.eye, [3, 2, 1], atol=1e-12)
    for bad in (2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.eye(3), np.full((4, 4), np.nan)):
        with pytest.raises(ValueError, match=r"camera\.matrix"):
            View(bad, 300, 310, 100, 90, 208, 192)


@pytest.mark.parametrize("name", ["width", "height"])
@pytest.mark.parametrize("size", [500, 0, -16])
def test_sizes_are_whole_tiles(name, size):
    sizes = {"width": 512, "height": 512, name: size}
    with pytest.raises(ValueError, match=rf"camera\.{name}={size} .*multiple of 16"):
        View(np.eye(4), 500, 500, 256, 256, **sizes)


def test_look_at_needs_an_up_across_the_line_of_sight():
    with pytest.raises(ValueError, match="camera: from eye"):
        look_at(CENTRE + [0, 1, 0], CENTRE, np.array([0.0, 1, 0]), 500, 500, 256, 256, 512, 512)


def test_points_behind_the_camera_have_no_image():
    view = framing(CENTRE, 0.3, 0.3, 40, 0, 0, 512, 512)
    xy, depth = project(view, (view.eye + [0, 0, 1])[None])
    assert np.isnan(xy).all()
    assert depth[0] < 0


@pytest.mark.parametrize("axis", range(0, 180, 15))
def test_default_view_holds_the_whole_motion_of_the_grips(axis: int) -> None:
    s = Scene(loading=Loading(axis_deg=axis, speed=1.4, offset=0.25))
    view = view_of(s)
    travel = s.loading.offset + s.loading.thickness / 2 + s.loading.speed * s.capture.duration
    ends = CENTRE + np.array([[travel], [-travel]]) * np.asarray(s.loading.axis)
    xy, depth = project(view, ends)
    assert (xy >= 0).all()
    assert (xy <= [view.width, view.height]).all()
    assert (depth > 0).all()


def test_explicit_camera_is_taken_as_it_is() -> None:
    matrix = np.eye(4)
    matrix[2, 3] = 3.0
    camera = Camera(width=64, height=32, matrix=matrix.ravel().tolist(), intrinsics=[50.0, 60.0, 32.0, 16.0])
    view = view_of(Scene(camera=camera))
    assert (view.fx, view.fy, view.cx, view.cy, view.width, view.height) == (50, 60, 32, 16, 64, 32)
    xy, depth = project(view, np.array([[1.0, 0.5, 1.0]]))
    assert depth == pytest.approx([4.0])
    assert xy[0] == pytest.approx([32 + 50 / 4, 16 + 60 * 0.5 / 4])


@pytest.mark.parametrize("size", [0.01, 0.05, 0.6, 1.6])
def test_the_near_plane_scales_with_the_distance_of_the_eye(size: float) -> None:
    """A scene of another size, alike in all lengths, is seen from as many of its sizes away."""
    s = Scene(asset=Asset(size=size), loading=Loading(speed=size, offset=0.25 * size, thickness=size / 12))
    view = view_of(s)
    distance = np.linalg.norm(view.eye - CENTRE)
    # Half the picture is 1.08 times half the size and the way of a grip, size m/s for 0.99 s.
    np.testing.assert_allclose(distance, 1.08 * 1.49 * size / np.tan(np.radians(20)), rtol=1e-9)
    np.testing.assert_allclose(view.near, NEAR * distance, rtol=1e-12)


@pytest.mark.parametrize("half_width", [0.001, 0.07, 0.2])
@pytest.mark.parametrize(("azimuth", "elevation"), [(0, 0), (35, 20), (90, 0), (180, 0), (0, 89), (-120, -40)])
def test_the_eye_stays_outside_the_object_and_the_near_plane_before_it(half_width, azimuth, elevation) -> None:
    camera = Camera(half_width=half_width, azimuth_deg=azimuth, elevation_deg=elevation)
    s = Scene(camera=camera, loading=Loading(axis_deg=30, speed=0.4))
    view = view_of(s)
    # The corners of the largest box that the object may fill, each also moved along with the grips.
    corners = s.asset.size / 2 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    way = s.loading.speed * s.capture.duration * np.asarray(s.loading.axis)
    _, depth = project(view, CENTRE + np.concatenate([corners - way, corners, corners + way]))
    assert depth.min() >= (1 - 1 / CLEAR) * np.linalg.norm(view.eye - CENTRE) * (1 - 1e-9)
    assert depth.min() > view.near
    np.testing.assert_allclose(project(view, CENTRE[None])[0], [[256, 256]], atol=1e-9)
    xy, _ = project(view, CENTRE + half_width * view.rotation[:1])
    np.testing.assert_allclose(xy, [[512, 256]], atol=1e-6)  # the half width is the one asked for


def test_a_field_of_view_is_kept_where_the_eye_has_room() -> None:
    view = view_of(Scene(camera=Camera(half_width=0.3)))
    np.testing.assert_allclose(view.fov_deg, 40, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(view.eye - CENTRE), 0.3 / np.tan(np.radians(20)), rtol=1e-12)
    near = view_of(Scene(camera=Camera(half_width=0.07), capture=Capture(frames=3)))
    # From the front an object of 0.6 m reaches 0.3 m towards the eye, and CLEAR keeps it 0.375 m away.
    np.testing.assert_allclose(np.linalg.norm(near.eye - CENTRE), 0.375, rtol=1e-12)
    np.testing.assert_allclose(near.fov_deg, 2 * np.degrees(np.arctan(0.07 / 0.375)), rtol=1e-12)
