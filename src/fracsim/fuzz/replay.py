"""One scene run again, with a table of its frames."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fracsim.fuzz.case import read
from fracsim.fuzz.run import Outcome, run
from fracsim.fuzz.table import lines
from fracsim.mpm import params as slot
from fracsim.records import Frame
from fracsim.solve.simulator import Simulator

COLUMNS = ("frame", "t [s]", "substeps", "dt [s]", "max |v| [m/s]", "max stretch", "min J", "failed", "work [J]",
           "kinetic", "elastic", "losses", "clamped")  # fmt: skip


def replay(path: Path, console: Console) -> Outcome:
    """Run the scene of a file again and print its frames and end; raises ValueError for a file without a case."""
    case = read(path)
    console.print(f"[bold]{case.name}[/]  {escape(str(case.scene))}", soft_wrap=True)
    console.print(f"{case.body}\n{case.start}", soft_wrap=True)
    frames = Table(*COLUMNS)
    for column in frames.columns:
        column.justify = "right"
    out = run(case, lambda simulator, frame, watch: frames.add_row(*_row(simulator, frame)))
    console.print(frames)
    if out.error:
        console.print(f"ended by {out.reason}: {escape(out.error)}", soft_wrap=True)
    for line in lines([out]) or [f"{out.verdict} as it should"]:
        console.print(line, soft_wrap=True)
    return out


def _row(simulator: Simulator, frame: Frame) -> list[str]:
    """The row of one frame; the volume ratio is the smallest of particles that have not failed."""
    h, sums = simulator.report.history, simulator.state.sums()
    F = frame.F[frame.d < 1]
    stretch = f"{h.stretch_max[-1]:.4g}"
    least = f"{np.linalg.det(F).min():.3g}" if len(F) else ""
    numbers = (
        sums[slot.GRIP_WORK] + sums[slot.GRAVITY_WORK],
        h.kinetic[-1],
        h.elastic[-1],
        sums[slot.DECAYED] + sums[slot.VISCOUS] + sums[slot.DAMAGED] + sums[slot.RELEASED],
    )
    fastest = float(np.linalg.norm(frame.v, axis=1).max())
    dt = f"{h.dt[-1]:.3g}" if h.dt else ""
    return [str(frame.index), f"{frame.t:.4g}", str(simulator.report.substeps), dt, f"{fastest:.3g}", stretch, least,
            str(int((frame.d >= 1).sum())), *(f"{x:.3g}" for x in numbers), f"{sums[slot.CLAMPED]:.0f}"]  # fmt: skip
