"""The lattices lie along the tearing axis: a body that is turned with the pull does the same at every angle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Asset, Backend, Capture, Fracture, Loading, Material, Scene, Solver
from fracsim.asset.build import build, build_of
from fracsim.asset.frame import LatticeFrame
from fracsim.lab.stage import bar, turned
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE
from fracsim.solve.simulator import Simulator


def scene(axis: float, **more: object) -> Scene:
    loading = Loading(axis_deg=axis, speed=0.8, grips="sliding", gravity=[0.0, 0.0, -9.0])
    return Scene(loading=loading, solver=Solver(cells=40), capture=Capture(frames=9), backend=Backend(threads=1),
                 material=Material(E=2e3, nu=0.3), fracture=Fracture(onset=1.1, crit=6.0), **more)  # fmt: skip


def upright(x: Array, axis: float) -> Array:
    """Points (N, 3) turned back by `axis` [deg], relative to the centre."""
    a = np.radians(axis)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    return np.asarray((x.astype(float) - CENTRE) @ R)


@pytest.mark.parametrize("axis", [37.5, 127.5, -150.0])
def test_a_bar_turned_with_the_pull_moves_as_the_aligned_bar(axis: float) -> None:
    """Up to the round-off of positions, 1e-7 m, enlarged a hundredfold at most: the load rises to the end, so that the
    place of a crack is no matter of chance."""
    straight = Simulator(scene(0.0), bar(scene(0.0).solver))
    oblique = Simulator(scene(axis), turned(bar(scene(axis).solver), axis))
    *_, a = straight.frames()
    *_, b = oblique.frames()
    assert (a.d > 0.01).any()
    # The grid sorts them by its own axes, so that the order may differ.
    order = np.lexsort(upright(straight.particles.X, 0).round(4).T)
    other = np.lexsort(upright(oblique.particles.X, axis).round(4).T)
    assert np.abs(upright(b.x, axis)[other] - upright(a.x, 0)[order]).max() < 1e-5
    assert np.abs(b.d[other] - a.d[order]).max() < 1e-3
    assert oblique.report.history.load[-1] == pytest.approx(straight.report.history.load[-1], rel=1e-3)
    stretches = [np.linalg.svd(f.F, compute_uv=False) for f in (b, a)]
    assert np.abs(stretches[0][other] - stretches[1][order]).max() < 1e-3


def test_particles_of_a_turned_mesh_are_those_of_the_mesh_turned(tmp_path: Path) -> None:
    import trimesh

    boxes = []
    for axis in (0.0, 30.0):
        mesh = trimesh.creation.box((0.6, 0.16, 0.1))
        mesh.apply_transform(trimesh.transformations.rotation_matrix(np.radians(axis), [0, 0, 1]))
        mesh.export(tmp_path / f"{axis}.obj")
        size = float(np.ptp(mesh.vertices, axis=0).max())
        boxes.append(build_of(scene(axis, asset=Asset(kind="mesh", path=str(tmp_path / f"{axis}.obj"), size=size))))
    straight, oblique = boxes
    assert len(straight) == len(oblique)
    apart = np.abs(upright(oblique.X, 30.0) - upright(straight.X, 0.0)).max(axis=1)
    assert apart[~straight.surface].max() < 1e-6  # round-off
    assert apart.max() < straight.spacing / 4  # on an edge, which face is nearer is a matter of round-off
    assert oblique.volume.sum() == pytest.approx(straight.volume.sum(), rel=1e-6)
    face = straight.surface & (np.abs(upright(straight.X, 0.0)) < [0.2, 1, 0.02]).all(axis=1)
    a = np.radians(30)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    assert face.any()
    assert np.abs(full(oblique.covariance)[face] - R @ full(straight.covariance)[face] @ R.T).max() < 1e-9


def full(covariance: Array) -> Array:
    """Covariances (N, 6) as matrices (N, 3, 3)."""
    out = np.empty((len(covariance), 3, 3))
    rows, columns = np.triu_indices(3)
    out[:, rows, columns] = out[:, columns, rows] = covariance
    return out


def test_an_object_keeps_its_place_and_volume_on_a_turned_lattice() -> None:
    """An object that is fixed in space is filled on another lattice; its outline stays within a spacing."""
    straight, oblique = (build(Asset(name="bear"), 0.03, 0, deg) for deg in (0.0, 30.0))
    assert oblique.volume.sum() == pytest.approx(straight.volume.sum(), rel=0.01)
    for end in (np.min, np.max):
        assert np.abs(end(oblique.X, axis=0) - end(straight.X, axis=0)).max() < 0.03


def test_the_frame_turns_axis_and_gravity_together() -> None:
    s = scene(127.5)
    frame = LatticeFrame(s.lattice_deg)
    s = replace(s, loading=replace(s.loading, gravity=[1.0, 2.0, 3.0]))
    inside = frame.scene(s).loading
    assert (s.lattice_deg, inside.axis_deg) == (37.5, 90.0)
    assert np.allclose(frame.vectors_to_world(np.array(inside.gravity)), [1, 2, 3])
    assert np.allclose(frame.vectors_to_world(np.array(inside.axis)), s.loading.axis)


def test_at_right_angles_and_with_lattice_world_nothing_is_turned() -> None:
    for s in (scene(0.0), scene(90.0), scene(-180.0), replace(scene(30.0), solver=Solver(lattice="world"))):
        assert s.lattice_deg == 0
        assert LatticeFrame(s.lattice_deg).scene(s) is s
    with pytest.raises(ValueError, match=r"solver\.walls=true .* set solver\.lattice=world"):
        Solver(formulation="updated", walls=True)
