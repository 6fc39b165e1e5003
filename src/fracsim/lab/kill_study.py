"""python -m fracsim.lab.kill_study: kill -9 a sweep at random moments, again and again, and count what is lost.

Two processes run the same sweep in the same folder, one from its last draw to its first. Each is killed at a random
time after it has begun a sample, and started again. At the end one process runs the sweep to its end.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from fracsim import sample
from fracsim.run import journal
from fracsim.run.attempt import MADE
from fracsim.sample.folder import is_whole

SCENE = ("solver.cells=40", "capture.frames=4", "camera.width=64", "camera.height=64", "capture.tracks=16",
         "backend.threads=1")  # fmt: skip
"""A scene of about two thousand particles."""
WINDOW = 2.0
"""Longest time from the first sample of a process to its end [s]; a clip takes about half a second."""


@dataclass(frozen=True)
class Counts:
    """What became of the sweep."""

    kills: int
    """Processes killed while they made a sample."""
    ended: int
    """Processes that reached the end of the sweep before they were killed."""
    wanted: int
    """Scenes of the sweep."""
    whole: int
    """Samples whose files all have the hashes of their meta.json."""
    broken: int
    """Folders with the name of a sample that were not whole, after any kill or at the end."""
    twice: int
    """Samples that were finished more than once."""
    left: int
    """Temporary folders at the end."""
    status: int
    """Exit status of the last process."""


def study(folder: Path, kills: int, scenes: int, processes: int = 2, seed: int = 0) -> Counts:
    """Kill `processes` sweeps of `scenes` scenes in `folder` `kills` times in all, then run it to the end."""
    rng, killed, ended, broken = random.Random(seed), 0, 0, set()
    while killed + ended < kills:
        running = [_start(folder, scenes, backwards=bool(i % 2)) for i in range(processes)]
        moments = {process: rng.uniform(0, WINDOW) for process in running}
        while running:
            time.sleep(0.01)
            for process in list(running):
                begun = _begun(folder, process)
                if process.poll() is not None:
                    ended += 1
                elif begun and time.time() - begun > moments[process]:
                    process.kill()
                    process.wait()
                    killed += 1
                else:
                    continue
                running.remove(process)
        broken |= _broken(folder)
    status = _start(folder, scenes).wait()
    made = Counter(entry["id"] for entry in journal.read(folder) if entry["status"] in MADE)
    paths = [path for path in folder.iterdir() if path.is_dir() and path.name.isalnum() and len(path.name) == 12]
    whole = [path for path in paths if not sample.verify(path)]
    left = len(list(folder.glob("*.partial-*"))) + len(list(folder.glob("*.replaced-*")))
    broken |= set(paths) - set(whole)
    return Counts(killed, ended, scenes, len(whole), len(broken), sum(n > 1 for n in made.values()), left, status)


def _start(folder: Path, scenes: int, backwards: bool = False) -> "subprocess.Popen[bytes]":
    """The sweep in a process of its own."""
    draws = f"range({scenes - 1},-1,-1)" if backwards else f"range(0,{scenes})"
    overrides = ("+sweep=table2", "asset=bread", f"draw={draws}", f"output.folder={folder}")
    return subprocess.Popen([sys.executable, "-m", "fracsim", *SCENE, *overrides], env={**os.environ},
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # fmt: skip


def _begun(folder: Path, process: "subprocess.Popen[bytes]") -> float:
    """When a process made its present or first temporary folder [s since 1970]; 0 = not yet."""
    if not hasattr(process, "begun") and next(folder.glob(f"*.partial-{process.pid}[.@]*"), None):
        process.begun = time.time()  # type: ignore[attr-defined]
    return float(getattr(process, "begun", 0.0))


def _broken(folder: Path) -> set[Path]:
    """Folders with the name of a sample that are not whole."""
    return {path.parent for path in folder.glob("*/meta.json")
            if path.parent.name.isalnum() and not is_whole(path.parent)}  # fmt: skip


def main() -> None:
    """Print the counts."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.lab.kill_study", description=__doc__)
    parser.add_argument("--kills", type=int, default=100, help="number of kills (100)")
    parser.add_argument("--scenes", type=int, default=150, help="scenes of the sweep (150)")
    parser.add_argument("--folder", type=Path, default=None, help="folder of the samples (a temporary one)")
    given = parser.parse_args()
    start = time.time()
    with tempfile.TemporaryDirectory() as temporary:
        c = study(given.folder or Path(temporary), given.kills, given.scenes)
    print(f"{c.kills} kills, {c.ended} ends before a kill, {time.time() - start:.0f} s; {c.wanted} samples wanted: "
          f"{c.whole} whole, {c.broken} broken, {c.twice} made twice, {c.left} temporary folders left; "
          f"exit status of the last run {c.status}")  # fmt: skip


if __name__ == "__main__":
    main()
