"""How a run ended; `health` says whether its numbers can be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from fracsim.sample import Sample, read
from fracsim.sample.health import UNACCOUNTED, health

__all__ = ["UNACCOUNTED", "Outcome", "Status", "health"]
Status = Literal["complete", "never breaks", "suspect", "failed", "interrupted", "existing"]


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
    """Why it is suspect, failed or interrupted; how an existing one differs from what would be made now."""
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
