"""A field set by hand that has no effect is refused; the same value from a file or from a draw is not."""

import pytest

from fracsim import Asset, compose
from fracsim.scene.effect import IDLE
from fracsim.scene.knob import describe
from fracsim.scene.vocab import Scene

POSE = ("camera.matrix=[1,0,0,0,0,-1,0,0,0,0,-1,3,0,0,0,1]", "camera.intrinsics=[500,500,256,256]")
MESH = ("asset=mesh", "asset.path=toy.glb")


@pytest.mark.parametrize(
    ("field", "beside"),
    [
        ("asset.name=duck", MESH),
        ("asset.opacity_threshold=0.1", MESH),
        ("asset.interior='#f2e0c0'", ()),
        ("camera.azimuth_deg=0", POSE),
        ("camera.elevation_deg=3", POSE),
        ("camera.fov_deg=30", POSE),
        ("camera.half_width=1", POSE),
        ("material.viscosity=3", ("solver.damping=none",)),
        ("material.decay=3", ("solver.damping=none",)),
        ("solver.dt_override=true", ()),
        ("solver.safety=0.5", ("solver.dt=1e-5",)),
        ("solver.projection=1", ("solver=updated",)),
    ],
)
def test_what_has_no_effect_is_refused(field: str, beside: tuple[str, ...]) -> None:
    name = field.partition("=")[0]
    with pytest.raises(ValueError, match=rf"^{name} has no effect here, since .*: (leave it out|give a substep)"):
        compose(*beside, field)


def test_each_rule_names_fields_of_a_scene() -> None:
    known = {name for name, _, _ in describe(Scene)}
    assert {name for idle in IDLE for name in idle.fields} <= known


def test_values_of_files_and_draws_may_lie_idle() -> None:
    """A draw sets the material's damping with any solver; quality=paper fixes the substep."""
    assert compose("asset=duck", "draw=3", "solver.damping=none").material.viscosity > 0
    assert compose("quality=paper").solver.dt == 1e-4


def test_a_path_beside_a_built_in_object_is_refused() -> None:
    """The object would be the built-in one, and the path only look like it."""
    for overrides in (["asset.path=toy.glb"], ["asset=duck", "asset.path=toy.glb"]):
        with pytest.raises(ValueError, match=r"asset\.path=toy\.glb has no effect .*: set asset=mesh for a mesh"):
            compose(*overrides)
    with pytest.raises(ValueError, match="has no effect"):
        Asset(path="toy.glb")
