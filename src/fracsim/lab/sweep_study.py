"""python -m fracsim.lab.sweep_study: what a draw costs beyond its simulation, memory over many draws, two processes.

The scenes are small (SCENE), so that hundreds of them take minutes. Other processes on the machine change all times;
the load average is printed beside them.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from fracsim import compose
from fracsim.lab.machine import cpu
from fracsim.run import journal

SCENE = ("solver.cells=60", "camera.width=128", "camera.height=128", "capture.tracks=256", "quality=preview")
"""The scenes of conf/sweep/smoke.yaml."""
SHORT = ("solver.cells=50", "capture.frames=30", "camera.width=64", "camera.height=64", "backend.threads=1")
"""Scenes for hundreds of draws."""
EARLY = 20
"""Draws after which all kernels have run and all arrays been made."""


def resident() -> float:
    """Resident memory of this process [MiB] (Linux)."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def draws(count: int, folder: Path) -> None:
    """Run draws of the bread in this process; print seconds beyond simulation and rendering, and memory."""
    from fracsim.run.attempt import Task
    from fracsim.run.sweep import run_one

    beyond, memory = [], []
    for draw in range(count):
        attempt = run_one(Task(compose("asset=bread", f"draw={draw}", *SHORT, f"output.folder={folder}")))
        phases = attempt.outcome.seconds
        beyond.append(attempt.wall - phases["simulate"] - phases["render"])
        memory.append(resident())
    rest = beyond[1:]
    print(f"{count} draws in one process: median {statistics.median(rest):.2f} s a draw beyond simulation and "
          f"rendering (90 % below {sorted(rest)[int(0.9 * len(rest))]:.2f} s)")  # fmt: skip
    if count > EARLY:
        slope = (memory[-1] - memory[EARLY]) / (count - 1 - EARLY)
        print(f"resident memory {memory[0]:.0f} MiB after the first draw, {memory[EARLY]:.0f} after draw {EARLY}, "
              f"{memory[-1]:.0f} after the last: {slope:+.3f} MiB a draw")  # fmt: skip


def side_by_side(clips: int, folder: Path) -> None:
    """Print clips an hour of one and of two single-thread processes, and of one with two threads."""
    rates = {}
    for name, processes, threads in (("1 process, 1 thread", 1, 1), ("2 processes, 1 thread each", 2, 1),
                                     ("1 process, 2 threads", 1, 2)):  # fmt: skip
        load = os.getloadavg()[0]
        rates[name] = rate(clips, processes, threads, folder / f"{processes}x{threads}")
        print(f"{name}: {rates[name]:.0f} clips/hour (load average before: {load:.1f})", flush=True)
    one, two, _ = rates.values()
    print(f"two single-thread processes make {two / one:.2f} times the clips of one")


def rate(clips: int, processes: int, threads: int, folder: Path) -> float:
    """Clips an hour of processes that run the same draws side by side, without their first clip."""
    folders = [folder / str(i) for i in range(processes)]
    running = [_start(clips, threads, f) for f in folders]
    for process in running:
        if process.wait():
            raise RuntimeError(f"the sweep in {folder} failed with status {process.returncode}")
    walls: list[list[float]] = [[entry["wall"] for entry in journal.read(f)][1:] for f in folders]
    return sum(3600 * len(w) / sum(w) for w in walls)


def _start(clips: int, threads: int, folder: Path) -> "subprocess.Popen[bytes]":
    """Draws of the bread in a process of its own."""
    command = ("+sweep=table2", "asset=bread", f"draw=range(0,{clips + 1})", f"backend.threads={threads}", *SCENE)
    return subprocess.Popen([sys.executable, "-m", "fracsim", *command, f"output.folder={folder}"],
                            stdout=subprocess.DEVNULL)  # fmt: skip


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.lab.sweep_study", description=__doc__)
    parser.add_argument("--draws", type=int, default=200, help="draws in one process, 0 = none (200)")
    parser.add_argument("--clips", type=int, default=8, help="clips of each process side by side, 0 = none (8)")
    given = parser.parse_args()
    print(f"{cpu()}, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as temporary:
        if given.draws:
            draws(given.draws, Path(temporary) / "draws")
        if given.clips:
            side_by_side(given.clips, Path(temporary))


if __name__ == "__main__":
    main()
