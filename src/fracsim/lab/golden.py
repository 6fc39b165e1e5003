"""`python -m fracsim.lab.golden`: has a change of the code changed what any scene computes?

Runs small scenes that reach every law, formulation, precision, pressure, grip, drive and kind of object, and prints a
digest each of positions, F, damage, pictures and report. They are equal bit for bit to those in the file when nothing
has changed. Processors round differently, so write the file (`--write`) at the commit before yours, on your machine.
"""

import argparse
import hashlib
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from fracsim import backend, registry
from fracsim.asset import ply
from fracsim.asset.build import build_of
from fracsim.lab.machine import cpu
from fracsim.records import Array
from fracsim.render.film import Film
from fracsim.scene.program import compose
from fracsim.scene.vocab import Backend, Scene
from fracsim.solve.march import SimulationError
from fracsim.solve.simulator import Simulator

FILE = Path("tests/reference/golden.json")
BASE = ("solver.cells=40", "camera.width=64", "camera.height=64", "capture.tracks=16", "backend.threads=1")
TORN = (*BASE, "loading.speed=4", "capture.frames=8", "capture.fps=100")
"""Breaks within eight frames."""
UPDATED = "solver=updated"
SCENES: dict[str, tuple[str, ...]] = {
    **{f"object {name}": (*TORN, f"asset={name}") for name in registry.names("fracsim.asset.objects")},
    "updated bread": (*TORN, UPDATED),
    "updated duck": (*TORN, UPDATED, "asset=duck"),
    "updated four particles an axis": (*TORN, UPDATED, "solver.particles_per_axis=4", "asset=bar"),
    "updated walls, gravity": (*TORN, UPDATED, "solver.walls=true", "loading.gravity=[0,-9.81,0]"),
    "updated float64, decoupled": (*TORN, UPDATED, "material=rubber_decoupled", "solver.precision=float64"),
    "updated sliding": (*TORN, UPDATED, "loading.grips=sliding"),
    "updated soft": (*TORN, UPDATED, "loading=soft"),
    "paper": (*TORN, "quality=paper", "solver.cells=40", "asset=bar"),
    "rubber": (*TORN, "material=rubber", "asset=bar"),
    "rubber decoupled": (*TORN, "material=rubber_decoupled", "asset=bar"),
    "rubber float64": (*TORN, "material=rubber", "solver.precision=float64", "asset=bar"),
    "bread float64": (*TORN, "solver.precision=float64"),
    "decoupled float64, particle": (*TORN, "material=rubber_decoupled", "solver.precision=float64",
                                    "solver.pressure=particle", "asset=bar"),
    "pressure of a particle": (*TORN, "solver.pressure=particle"),
    "rubber, pressure of a particle": (*TORN, "solver.pressure=particle", "material=rubber", "asset=star"),
    "sliding grips at 30 degrees": (*TORN, "loading.grips=sliding", "loading.axis_deg=30"),
    "rigid grips at 15 degrees": (*TORN, "loading.axis_deg=15", "asset=duck"),
    "soft grips": (*TORN, "loading=soft"),
    "damping per substep": (*TORN, "solver.damping=per_substep"),
    "no damping": (*TORN, "solver.damping=none"),
    "gravity": (*TORN, "loading.gravity=[0,-9.81,0]"),
    "projection in every substep": (*TORN, "solver.projection=every"),
    "fixed dt": (*TORN, "solver.dt=1e-4"),
    "damage at grips": (*TORN, "fracture.at_grips=true"),
    "thresholds of other cells": (*TORN, "fracture.length=0.04", "asset=bar"),
    "settled": (*BASE, "loading.speed=6", "capture.frames=16", "capture.fps=50", "solver.until=settled",
                "material.viscosity=400", "asset=croissant"),
    "one and a half particles an axis": (*TORN, "solver.particles_per_axis=1.5", "solver.cells=60"),
    "oblique camera, one map": (*TORN, "camera=oblique", "capture.maps=[damage]", "asset=bear"),
    "two threads": (*TORN, "solver.cells=100", "backend.threads=2"),
    "mesh": (*TORN, "asset=mesh", "asset.path=MESH", "material=rubber"),
    "splats": (*TORN, "asset=ply", "asset.path=SPLATS"),
    "blows up": (*TORN, "solver.cells=100", "solver.dt=9e-3", "solver.dt_override=true", "asset=bar"),
}  # fmt: skip


def digest(*arrays: Any) -> str:
    """First 16 hex digits of the sha256 of arrays: types, shapes and bytes."""
    sha = hashlib.sha256()
    for array in map(np.ascontiguousarray, arrays):
        sha.update(f"{array.dtype} {array.shape} ".encode() + array.tobytes())
    return sha.hexdigest()[:16]


def record(scene: Scene) -> dict[str, str]:
    """Digests of one scene over all its frames, and of its report; the last error, if it ends by one."""
    simulator, film = Simulator(scene, build_of(scene)), Film(scene)
    kept: dict[str, list[Array]] = {name: [] for name in ("x", "v", "F", "tau", "d", "pictures")}
    ended, tracked = "", np.zeros(0, int)
    try:
        for frame in simulator.frames():
            picture = film.shoot(frame, simulator.particles)
            if frame.index == 0:
                tracked = film.choose_tracks(frame, simulator.particles, picture)
            for name in ("x", "v", "F", "tau", "d"):
                kept[name].append(getattr(frame, name))
            shown = [picture.rgb, picture.alpha, *picture.maps.values(), *film.tracks(frame, tracked, picture)]
            kept["pictures"].append(np.frombuffer(digest(*shown).encode(), np.uint8))
    except SimulationError as error:
        ended = str(error)
    report = json.dumps([simulator.report.summary(), vars(simulator.report.history)], sort_keys=True)
    out = {name: digest(*arrays) for name, arrays in kept.items()}
    return {**out, "report": digest(np.frombuffer(report.encode(), np.uint8)), "ended": ended}


def files(folder: Path) -> dict[str, str]:
    """A mesh and a splat file of degree 1, made without chance; MESH and SPLATS in overrides stand for them."""
    import trimesh

    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    mesh.apply_scale([1.6, 1.0, 0.8])
    mesh.export(folder / "ellipsoid.obj")
    rng = np.random.default_rng(0)
    n = 4000
    way = rng.normal(size=(n, 3))
    means = way / np.linalg.norm(way, axis=1, keepdims=True) * [0.5, 0.3, 0.25]
    covariance = np.tile(np.array([1.0, 0, 0, 1.0, 0, 1.0]) * 0.02**2, (n, 1))
    sh = 0.3 * rng.normal(size=(n, 4, 3))
    ply.write(folder / "shell.ply", means, covariance, np.full(n, 0.9), sh)
    return {"MESH": str(folder / "ellipsoid.obj"), "SPLATS": str(folder / "shell.ply")}


def records(names: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """The digests of these scenes."""
    with tempfile.TemporaryDirectory() as folder:
        paths = files(Path(folder))
        for name in names:
            overrides = [o.replace("MESH", paths["MESH"]).replace("SPLATS", paths["SPLATS"]) for o in SCENES[name]]
            yield name, record(compose(*overrides))


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """What the user wants."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.lab.golden", description=__doc__)
    parser.add_argument("--write", action="store_true", help="write the file instead of comparing with it")
    parser.add_argument("--file", type=Path, default=FILE, help=f"where digests are kept ({FILE})")
    parser.add_argument("--only", nargs="+", metavar="SCENE", default=list(SCENES), choices=list(SCENES))
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Print a line a scene; 1 when one differs from the file."""
    wanted = arguments(argv)
    backend.start(Backend(threads=2))
    known = {} if wanted.write else json.loads(wanted.file.read_text(encoding="utf-8"))
    if known and known["cpu"] != cpu():
        print(f"written on {known['cpu']}, this is {cpu()}: digests may differ by rounding")
    found, differ, since = {}, [], time.perf_counter()
    for name, got in records(wanted.only):
        found[name] = got
        changed = [part for part in got if known and got[part] != known["scenes"].get(name, {}).get(part)]
        differ += [name] * bool(changed)
        print(f"{name:<34} {got['x']} {got['pictures']} {got['report']}  "
              f"{'DIFFERS: ' + ', '.join(changed) if changed else ''}{got['ended'][:60]}", flush=True)  # fmt: skip
    if wanted.write:
        wanted.file.write_text(json.dumps({"cpu": cpu(), "scenes": found}, indent=1) + "\n", encoding="utf-8")
    print(f"{len(found)} scenes in {time.perf_counter() - since:.0f} s, "
          f"{'written to ' + str(wanted.file) if wanted.write else f'{len(differ)} differ'}")  # fmt: skip
    return int(bool(differ))


if __name__ == "__main__":
    sys.exit(main())
