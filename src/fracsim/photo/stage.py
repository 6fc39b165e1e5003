"""A scene with a photo, made self-contained: a condition file becomes fields, the photo's camera becomes numbers."""

import warnings
from dataclasses import replace

import numpy as np

from fracsim.photo.outline import Outline, outline
from fracsim.records import Array
from fracsim.scene import condition
from fracsim.scene.classes import LAWS
from fracsim.scene.condition import Condition
from fracsim.scene.program import compose
from fracsim.scene.vocab import Loading, Material, Scene

PRESETS = {"low_stretch": "bread", "high_stretch": "rubber"}
"""File of conf/material for the kind of fracture of a condition."""
TOLERATED = 0.02
"""Part of the object's size, and of the grips' speed, by which a pull may differ from a mirrored one without a word."""


def staged(scene: Scene) -> Scene:
    """A scene without condition file, whose camera is that of its photo where camera.background=photo.

    A scene that is so already, or has no photo, is returned as it is. Raises ValueError for a photo or a condition
    file that cannot be used, and warns of a pull that the simulator cannot follow.
    """
    if scene.condition:
        given = condition.load(scene.condition)
        scene = replace(
            scene,
            condition="",
            material=_material(scene.material, given),
            fracture=replace(scene.fracture, onset=given.onset, crit=given.crit),
            loading=pull(given, outline(scene.asset), scene.asset.size, scene.loading),
            capture=replace(scene.capture, fps=given.fps),
        )
    if scene.camera.background == "photo" and not scene.camera.matrix:
        camera = scene.camera
        view = outline(scene.asset).view(scene.asset.size, camera.width, camera.height)
        matrix = [float(v) for v in view.world_to_camera.ravel()]
        scene = replace(scene, camera=replace(camera, matrix=matrix, intrinsics=[view.fx, view.fy, view.cx, view.cy]))
    return scene


def _material(material: Material, given: Condition) -> Material:
    """A material of the condition's kind with its stiffness: `material`, if it is of that kind, or else a preset."""
    if LAWS.get(material.law, given.category) != given.category:
        material = compose(f"material={PRESETS[given.category]}").material
    return replace(material, E=given.E, nu=given.nu)


def pull(given: Condition, seen: Outline, size: float, loading: Loading) -> Loading:
    """The loading of a condition on an object of largest extent `size` [m].

    The simulator pulls along one axis, mirrored about the object's centre: warns where a condition does not. Raises
    ValueError for grips that do not part.
    """
    pixels = np.array(seen.photo.size, float)
    grips, moved = (np.reshape(v, (2, 2)) for v in (given.grips, given.velocity))
    at = seen.to_plane(grips * pixels) * size
    velocity = (moved * pixels * (1, -1)) * size / seen.extent
    apart = at[1] - at[0]
    distance = float(np.linalg.norm(apart))
    if distance < 1e-6 * size:
        raise ValueError(f"condition.grips={given.grips} lie on each other: move them apart.")
    axis = apart / distance
    speed = float((velocity[1] - velocity[0]) @ axis / 2)
    if speed <= 0:
        raise ValueError(f"condition.velocity={given.velocity} does not part the grips {given.grips}: point it away "
                         "from the object's centre.")  # fmt: skip
    _tell(at, velocity, axis, speed, size)
    angle = float(np.degrees(np.arctan2(axis[1], axis[0])))
    return replace(loading, axis_deg=angle + 0.0, offset=distance / 2, speed=speed)


def _tell(at: Array, velocity: Array, axis: Array, speed: float, size: float) -> None:
    """Warn of grips at (2, 2) [m] with velocities (2, 2) [m/s] that are not mirrored about the object's centre."""
    off = float(np.linalg.norm(at.mean(axis=0)))
    if off > TOLERATED * size:
        warnings.warn(f"condition.grips: their middle is {off / size:.1%} of the object's size away from its centre; "
                      "the simulator pulls mirrored about the centre, and the grips were moved there.",
                      stacklevel=4)  # fmt: skip
    aside = float(np.abs(velocity - np.outer((-speed, speed), axis)).max())
    if aside > TOLERATED * speed:
        warnings.warn("condition.velocity: the simulator pulls both grips equally fast along the line through them, "
                      f"here at {speed:.3g} m/s.", stacklevel=4)  # fmt: skip
