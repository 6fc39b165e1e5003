"""How a run ended, and the rule that says whether its numbers can be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from fracsim.sample import Sample, read
from fracsim.solve.report import CRUSHED

Status = Literal["complete", "never breaks", "suspect", "failed", "interrupted", "existing"]
UNACCOUNTED = 0.05
"""A run is suspect whose energy balance misses more than this fraction of the work."""


@dataclass(frozen=True)
class Outcome:
    """How the run of a scene ended.

    complete: the object broke and the numbers are sound; never breaks: it is whole at the last frame; suspect: all
    frames are there, but see `reason`; failed or interrupted: see `reason`, and `path` for the frames until then;
    existing: a whole sample was there, and nothing was run.
    """

    status: Status
    path: Path | None = None
    """Folder of the sample, also of an incomplete one; None when there is none."""
    reason: str = ""
    """Why it is suspect, failed or interrupted."""
    report: Mapping[str, Any] = field(default_factory=dict)
    """`Report.summary()`, as in meta.json; empty when no frame was finished."""
    seconds: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time by phase [s]."""
    frames: int = 0
    """Frames in the sample."""

    @property
    def finished(self) -> bool:
        """Whether a sample with all frames is there."""
        return self.status not in ("failed", "interrupted")

    def sample(self) -> Sample:
        """Open the sample; raises RuntimeError with the reason when the run failed or was interrupted."""
        if not self.finished or self.path is None:
            raise RuntimeError(self.reason)
        return read(self.path)


def health(report: Mapping[str, Any]) -> tuple[Status, str]:
    """The status of a run with all its frames, "complete", "never breaks" or "suspect", and the reasons for the last.

    `report` is that of meta.json. Suspect is a run that was torn numerically, whose energy balance misses more than
    UNACCOUNTED of the work, or that crushed more particles than its report passes without a warning.
    """
    doubts, energy = [], report["energy"]
    if report["torn_frame"] is not None:
        doubts.append(f"numerically torn at frame {report['torn_frame']}")
    work = abs(energy["grip_work"]) + abs(energy["gravity_work"])
    if abs(energy["unaccounted"]) > UNACCOUNTED * work:
        doubts.append(f"energy unaccounted: {energy['unaccounted']:.3g} J of {work:.3g} J of work")
    crushed = report["clamped"] / max(report["particles"] * report["substeps"], 1)
    if crushed > CRUSHED:
        doubts.append(f"J < 0.05 in {100 * crushed:.2g} % of all substeps of all particles")
    if doubts:
        return "suspect", "; ".join(doubts)
    return ("never breaks" if report["break_frame"] is None else "complete"), ""
