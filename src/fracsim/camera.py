"""Pinhole cameras as plain records, and the projection of points for tracks; no Taichi here.

Camera space has x right, y DOWN and z forward, the convention of 3DGS and OpenCV. Pixel (column, row) has its centre
at (column + 0.5, row + 0.5), so the picture spans [0, width] x [0, height].
"""

import math
from dataclasses import dataclass

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import CENTRE, Scene

NEAR = 0.05
"""Part of the eye's distance from the object's centre up to which Gaussians and points are culled. In 3DGS (Kerbl et
al. 2023) it is 0.2 of whatever unit a scene has; here objects are from 1 cm to 1.6 m large."""
CLEAR = 1.25
"""The eye of a view by angles stays this many times as far from the centre as the object can reach towards it."""
TILE = 16
"""Edge of a square tile [px]; pictures are whole tiles."""
PHOTO_DISTANCE = 4.0
"""Distance of the eye from an object that comes from a photo, in its largest extents: photos are taken from so far."""
MARGIN = 1.08
"""The default view holds the travel of the grips times this."""


@dataclass(frozen=True, eq=False)
class View:
    """A pinhole camera: pose, focal lengths and principal point, picture size; raises ValueError on a bad one."""

    world_to_camera: Array
    """Rigid motion from world [m] to camera space [m], (4, 4) float64."""
    fx: float
    """Focal length along image x [px]."""
    fy: float
    """Focal length along image y [px]."""
    cx: float
    """Image x of the optical axis [px]."""
    cy: float
    """Image y of the optical axis [px]."""
    width: int
    """Picture width [px], a multiple of TILE."""
    height: int
    """Picture height [px], a multiple of TILE."""

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            size = getattr(self, name)
            if size < TILE or size % TILE:
                raise ValueError(f"camera.{name}={size} must be a positive multiple of {TILE}, as 512.")
        for name in ("fx", "fy"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"camera.intrinsics: {name}={getattr(self, name)} must be positive and finite [px].")
        object.__setattr__(self, "world_to_camera", _rigid(self.world_to_camera))

    @property
    def rotation(self) -> Array:
        """Rotation from world to camera axes, (3, 3)."""
        return self.world_to_camera[:3, :3]

    @property
    def eye(self) -> Array:
        """Position of the pinhole in the world [m], (3,)."""
        eye: Array = -self.rotation.T @ self.world_to_camera[:3, 3]
        return eye

    @property
    def near(self) -> float:
        """Depth up to which Gaussians and points are culled [m]: the part NEAR of the distance of eye and object."""
        return NEAR * float(np.linalg.norm(self.eye - CENTRE))

    @property
    def fov_deg(self) -> float:
        """Vertical field of view [deg]."""
        return 2 * math.degrees(math.atan(self.height / 2 / self.fy))


def _rigid(matrix: Array) -> Array:
    """`matrix` as (4, 4) float64; raises ValueError unless it is a rotation and a translation."""
    pose = np.asarray(matrix, dtype=np.float64)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise ValueError(f"camera.matrix has shape {pose.shape}: give 16 finite numbers, by rows.")
    R = pose[:3, :3]
    # 1e-4 passes a matrix written with five digits; a scaled or mirrored one is far outside.
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-4 or np.linalg.det(R) < 0 or (pose[3] != (0, 0, 0, 1)).any():
        raise ValueError(
            f"camera.matrix={pose.tolist()} is not a rigid motion: its upper left 3 x 3 must be a rotation "
            "(no scale, no mirror) and its last row 0 0 0 1; take the world-to-camera matrix, x right, y down, z ahead."
        )
    return pose


def look_at(
    eye: Array, centre: Array, up: Array, fx: float, fy: float, cx: float, cy: float, width: int, height: int
) -> View:
    """The view from `eye` [m] to `centre` [m] with `up` upwards in the picture, each (3,).

    Raises ValueError when eye and centre coincide, or up points along the line of sight.
    """
    eye, forward = np.asarray(eye, dtype=np.float64), np.subtract(centre, eye, dtype=np.float64)
    right = np.cross(forward, up)
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(forward) * np.linalg.norm(up):
        raise ValueError(f"camera: from eye={eye.tolist()} to centre={centre} with up={up} leaves the picture's "
                         "turn open: move the eye, or choose an up that is not along the line of sight.")  # fmt: skip
    axes = np.stack([right, np.cross(forward, right), forward])
    pose = np.eye(4)
    pose[:3, :3] = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    pose[:3, 3] = -pose[:3, :3] @ eye
    return View(pose, fx, fy, cx, cy, width, height)


def framing(
    centre: Array,
    half_width: float,
    half_height: float,
    fov_deg: float,
    azimuth_deg: float,
    elevation_deg: float,
    width: int,
    height: int,
    least: float = 0.0,
) -> View:
    """The view that just holds a rectangle of half sizes [m] around `centre` [m], (3,), facing the camera.

    `fov_deg` is the vertical field of view. At azimuth and elevation 0 the camera looks along -z with y up; azimuth
    turns it counter-clockwise seen from above, elevation lifts it. What stands nearer than the rectangle looks larger
    and needs a margin. The eye keeps the distance `least` [m]: where the field of view would bring it nearer, the field
    of view is narrowed instead, so that the rectangle is held all the same.
    """
    focal = 0.5 * height / math.tan(math.radians(fov_deg) / 2)
    distance = focal * max(2 * half_width / width, 2 * half_height / height)
    if distance < least:
        focal, distance = focal * least / distance, least
    towards_eye = direction(azimuth_deg, elevation_deg)
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    sin, cos = math.sin(elevation), math.cos(elevation)
    # The derivative of towards_eye by elevation: up, also straight above and below.
    up = np.array([-math.sin(azimuth) * sin, cos, -math.cos(azimuth) * sin])
    eye = np.asarray(centre) + distance * towards_eye
    return look_at(eye, centre, up, fx=focal, fy=focal, cx=width / 2, cy=height / 2, width=width, height=height)


def direction(azimuth_deg: float, elevation_deg: float) -> Array:
    """Unit vector from the centre to the eye, (3,)."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(elevation_deg)
    cos = math.cos(elevation)
    return np.array([math.sin(azimuth) * cos, math.sin(elevation), math.cos(azimuth) * cos])


def view_of(scene: Scene) -> View:
    """The camera of a scene: explicit, or a view of the object and of the full travel of both grips.

    A view by angles keeps the eye outside the object, see `framing` and CLEAR; an explicit one is taken as it is. An
    object from a photo is seen from PHOTO_DISTANCE, so that it looks as in the photo. Raises ValueError where the
    camera is that of a photo and has no matrix yet: `fracsim.photo.stage.staged` gives it.
    """
    c = scene.camera
    if c.background == "photo" and not c.matrix:
        raise ValueError("camera.background=photo has no camera.matrix yet: take `fracsim.photo.stage.staged(scene)`.")
    if c.matrix:
        fx, fy, cx, cy = c.intrinsics
        return View(np.reshape(c.matrix, (4, 4)), fx, fy, cx, cy, c.width, c.height)
    travel = scene.loading.speed * scene.capture.duration
    u = np.abs(scene.loading.axis)
    half = MARGIN * (scene.asset.size / 2 + travel * u)
    width = c.half_width or float(half[0])
    height = c.half_width * c.height / c.width or float(half[1])
    towards_eye = np.abs(direction(c.azimuth_deg, c.elevation_deg))
    # A box of the largest extent, and the way of a grip.
    reach = scene.asset.size / 2 * towards_eye.sum() + travel * float(u @ towards_eye)
    fov = c.fov_deg
    if scene.asset.kind == "image":
        fov = 2 * math.degrees(math.atan(max(height, width * c.height / c.width) / (PHOTO_DISTANCE * scene.asset.size)))
    return framing(np.asarray(CENTRE), width, height, fov, c.azimuth_deg, c.elevation_deg, c.width, c.height,
                   least=CLEAR * reach)  # fmt: skip


def project(view: View, points: Array) -> tuple[Array, Array]:
    """Image positions [px], (N, 2), and depths [m], (N,), of points [m], (N, 3); NaN positions up to depth 0."""
    x, y, z = (np.asarray(points) @ view.rotation.T + view.world_to_camera[:3, 3]).T
    ahead = np.where(z > 0, z, np.nan)
    return np.stack([view.fx * x / ahead + view.cx, view.fy * y / ahead + view.cy], axis=1), z


def depths(view: View, points: Array) -> Array:
    """Depths [m], (N,), of points [m], (N, 3)."""
    return np.asarray(np.asarray(points) @ view.rotation[2] + view.world_to_camera[2, 3])
