"""Fields that have no effect beside others: whoever sets one by hand has something else in mind."""

from collections.abc import Callable, Collection
from dataclasses import dataclass

from fracsim.scene.vocab import Scene


@dataclass(frozen=True)
class Idle:
    """When fields have no effect, and what to do about it."""

    fields: tuple[str, ...]
    when: Callable[[Scene], bool]
    why: str
    """As the end of a sentence; {scene} is the scene."""
    way_out: str


IDLE = (
    Idle(("asset.name",), lambda s: s.asset.kind != "builtin", "the object is read from asset.path",
         "leave it out, or choose the built-in object by asset=NAME"),
    Idle(("asset.opacity_threshold",), lambda s: s.asset.kind != "ply", "only trained splats have it",
         "leave it out, or set asset=ply"),
    Idle(("asset.interior",), lambda s: s.asset.kind == "builtin", "built-in objects have their own inside",
         "leave it out"),
    Idle(("asset.mask", "asset.cutout", "asset.depth", "asset.back", "asset.base"), lambda s: s.asset.kind != "image",
         "only photos have it", "leave it out, or set asset=image"),
    Idle(("asset.cutout",), lambda s: bool(s.asset.mask), "asset.mask says what the object is",
         "leave it out, or leave out asset.mask"),
    Idle(("camera.fov_deg",), lambda s: s.asset.kind == "image" and not s.camera.matrix,
         "the eye stays where the photo was taken", "leave it out, or set camera.half_width"),
    Idle(("camera.azimuth_deg", "camera.elevation_deg", "camera.half_width"), lambda s: s.camera.background == "photo",
         "camera.background=photo shows what the photo shows", "leave it out, or set camera.background=white"),
    Idle(("material.E", "material.nu", "fracture.onset", "fracture.crit", "loading.axis_deg", "loading.offset",
          "loading.speed", "capture.fps"), lambda s: bool(s.condition), "the condition file sets it",
         "leave it out, or change the file"),
    Idle(("camera.azimuth_deg", "camera.elevation_deg", "camera.fov_deg", "camera.half_width"),
         lambda s: bool(s.camera.matrix), "camera.matrix and camera.intrinsics say it all",
         "leave it out, or leave out camera.matrix"),
    Idle(("material.viscosity", "material.decay"), lambda s: s.solver.damping == "none",
         "solver.damping=none switches it off", "leave it out, or set solver.damping=physical"),
    Idle(("solver.dt_override",), lambda s: s.solver.dt == "auto", "solver.dt=auto keeps to the bound",
         "give a substep, as solver.dt=1e-4"),
    Idle(("solver.safety",), lambda s: s.solver.dt != "auto", "the substep is fixed by solver.dt",
         "leave it out, or set solver.dt=auto"),
    Idle(("solver.projection",), lambda s: s.solver.formulation == "updated", "updated projects in every substep",
         "leave it out, or set solver.formulation=total"),
)  # fmt: skip


def check(scene: Scene, given: Collection[str]) -> None:
    """Raise ValueError for the first field among `given`, set by hand, that has no effect in a scene."""
    for idle in IDLE:
        for name in idle.fields:
            if name in given and idle.when(scene):
                raise ValueError(f"{name} has no effect here, since {idle.why}: {idle.way_out}.")
