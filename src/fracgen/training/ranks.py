"""Which process of a training this is."""

from lightning.pytorch.utilities import rank_zero_only


def rank() -> int:
    """Number of this process among all of a training; 0 before Lightning has started the others."""
    return int(getattr(rank_zero_only, "rank", None) or 0)
