"""The rule that says whether the numbers of a finished run can be trusted; it reads the report in meta.json."""

import math
from collections.abc import Mapping
from typing import Any, Literal

Health = Literal["complete", "never breaks", "suspect"]
UNACCOUNTED = 0.05
"""A run is suspect whose energy balance misses more than this fraction of the work."""
CRUSHED = 1e-3
"""A run is suspect that crushed more than this fraction of its particle-substeps. At a crack some particles are crushed
that have nearly failed: the report warns from a hundredth of this on, and the energy balance shows whether it matters.
"""


def health(report: Mapping[str, Any]) -> tuple[Health, str]:
    """The status of a run with all its frames, "complete", "never breaks" or "suspect", and the reasons for the last.

    `report` is that of meta.json, where null stands for a number that is not finite. Suspect is a run that was torn
    numerically, whose energy balance misses more than UNACCOUNTED of the work or is not finite, or that crushed more
    than CRUSHED of its particle-substeps.
    """
    doubts, energy = [], {k: math.nan if v is None else v for k, v in report["energy"].items()}
    if report["torn_frame"] is not None:
        doubts.append(f"numerically torn at frame {report['torn_frame']}")
    work = abs(energy["grip_work"]) + abs(energy["gravity_work"])
    if not abs(energy["unaccounted"]) <= UNACCOUNTED * work:  # also of NaN
        doubts.append(f"energy unaccounted: {energy['unaccounted']:.3g} J of {work:.3g} J of work")
    crushed = report["clamped"] / max(report["particles"] * report["substeps"], 1)
    if crushed > CRUSHED:
        doubts.append(f"J < 0.05 in {100 * crushed:.2g} % of all substeps of all particles")
    if doubts:
        return "suspect", "; ".join(doubts)
    return ("never breaks" if report["break_frame"] is None else "complete"), ""
