"""Peak memory of a whole run of a bar that tears, from the object to the videos."""

import argparse
import json
import resource
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

from fracsim.bench.bar import DENSITY, NU
from fracsim.bench.plan import Plan
from fracsim.bench.record import Row
from fracsim.bench.worker import Worker
from fracsim.scene.vocab import Asset, Capture, Fracture, Loading, Material, Output, Scene, Solver

MOST = 2.0
"""Target for 200,000 particles [GiB]."""


def rows(plan: Plan) -> Iterator[Row]:
    """One run, with Taichi's usual cache. Raises RuntimeError if the bar does not tear: tearing needs most memory."""
    with Worker("memory", plan.memory_cells) as worker:
        result = worker.ready
    if not result["failed"]:
        raise RuntimeError("the bar of the memory benchmark did not tear: change its scene.")
    what = f"peak memory, {result['particles']:,} particles"
    yield Row(what, "process and video encoders", result["process"] + result["encoders"], "GiB", most=MOST)
    yield Row(what, "video encoders", result["encoders"], "GiB")


def scene(cells: int, folder: str) -> Scene:
    """A brittle bar that tears within a few frames; RGB and four maps of 512 x 512."""
    return Scene(
        asset=Asset(name="bar"),
        material=Material(E=6e3, nu=NU, density=DENSITY, viscosity=44.4, decay=5.0),
        fracture=Fracture(onset=1.05, crit=1.2),
        loading=Loading(speed=0.8),
        solver=Solver(cells=cells),
        capture=Capture(frames=8),
        output=Output(folder=folder),
    )


class Encoders(threading.Thread):
    """Watches the total memory of the child processes of this process (Linux; 0 elsewhere)."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.most = 0.0
        self._done = threading.Event()

    def run(self) -> None:
        """Sample every 50 ms until `stop`."""
        while not self._done.wait(0.05):
            pids = [pid for file in Path("/proc/self/task").glob("*/children") for pid in file.read_text().split()]
            self.most = max(self.most, sum(map(resident, pids)))

    def stop(self) -> float:
        """Stop sampling; returns the largest sum of resident memory [GiB]."""
        self._done.set()
        self.join()
        return self.most


def resident(pid: str) -> float:
    """Resident memory of a process [GiB]; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize() / 2**30
    except OSError:
        return 0.0


def peak() -> float:
    """Peak resident memory of this process [GiB]. The system reports KiB on Linux and bytes on macOS."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**30 if sys.platform == "darwin" else 2**20)


def main() -> None:
    """The process whose memory is measured: run the scene and print the figures as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("cells", type=int)
    cells = parser.parse_args().cells
    from fracsim.run import pipeline

    encoders = Encoders()
    encoders.start()
    with tempfile.TemporaryDirectory() as folder:
        report = pipeline.run(scene(cells, folder)).sample().meta["report"]
    result = {"process": peak(), "encoders": encoders.stop()}
    print(json.dumps({**result, "particles": report["particles"], "failed": report["failed"]}), flush=True)


if __name__ == "__main__":
    main()
