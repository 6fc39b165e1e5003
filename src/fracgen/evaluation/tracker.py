"""What a point tracker is to a metric."""

from typing import Any, Protocol

from fracgen.evaluation.clip import Clip
from fracsim.records import Array


class Tracker(Protocol):
    """Follows points of a picture through a clip."""

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Positions of N points in frames t0 to t1, (t1 - t0 + 1, N, 2) float64 [px], and whether each is seen there.

        queries (N, 2) are their positions in frame t0 [px], as of `fracgen.evaluation.queries`; what is seen is
        (t1 - t0 + 1, N) bool. A point that is lost has any position, also NaN, and is not seen.
        Raises LackingError when the clip has not what is needed.
        """
        ...

    def about(self) -> dict[str, Any]:
        """Its name, settings, versions and weights."""
        ...
