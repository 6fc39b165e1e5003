"""One scene again, told frame by frame."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from fracsim.fuzz.case import read
from fracsim.fuzz.invariants import Watch
from fracsim.fuzz.run import Outcome, run
from fracsim.fuzz.table import lines
from fracsim.mpm import params as slot
from fracsim.records import Frame
from fracsim.solve.simulator import Simulator

COLUMNS = ("frame", "t [s]", "substeps", "dt [s]", "max |v| [m/s]", "max stretch", "min J", "failed", "work [J]",
           "kinetic", "elastic", "losses", "clamped")  # fmt: skip


def replay(path: Path, console: Console) -> Outcome:
    """Run the scene of a file again and print what happens; raises ValueError when the file is none."""
    case = read(path)
    console.print(f"[bold]{case.name}[/]  {escape(str(case.scene))}", soft_wrap=True)
    console.print(f"{case.body}\n{case.start}", soft_wrap=True)
    told = Table(*COLUMNS)
    for column in told.columns:
        column.justify = "right"
    out = run(case, lambda simulator, frame, watch: told.add_row(*_row(simulator, frame, watch)))
    console.print(told)
    if out.error:
        console.print(f"ended by {out.reason}: {escape(out.error)}", soft_wrap=True)
    for line in lines([out]) or [f"{out.verdict} as it should"]:
        console.print(line, soft_wrap=True)
    return out


def _row(simulator: Simulator, frame: Frame, watch: Watch) -> list[str]:
    """One frame; volume ratio of what has not failed."""
    h, books = simulator.report.history, simulator.state.sums()
    F = frame.F[frame.d < 1]
    stretch = f"{h.stretch_max[-1]:.4g}"
    least = f"{np.linalg.det(F).min():.3g}" if len(F) else ""
    numbers = (
        books[slot.GRIP_WORK] + books[slot.GRAVITY_WORK],
        h.kinetic[-1],
        h.elastic[-1],
        books[slot.DECAYED] + books[slot.VISCOUS] + books[slot.DAMAGED] + books[slot.RELEASED],
    )
    fastest = float(np.linalg.norm(frame.v, axis=1).max())
    dt = f"{h.dt[-1]:.3g}" if h.dt else ""
    return [str(frame.index), f"{frame.t:.4g}", str(simulator.report.substeps), dt, f"{fastest:.3g}", stretch, least,
            str(int((frame.d >= 1).sum())), *(f"{x:.3g}" for x in numbers), f"{books[slot.CLAMPED]:.0f}"]  # fmt: skip
