"""Scales and opacities as files store them: by logarithm and logit, or as they are, which only shows in the values."""

import numpy as np

from fracsim.records import Array

ENOUGH = 8
"""Fewer Gaussians than this show nothing."""
COVERING = 0.25
"""Gaussians whose deviations exceed this share of the object cover it: no trained model has half of them so large."""
SURE = 0.9
"""A linear opacity of this or more; as a logit it would be 0.71 at most."""


def deviations(scales: Array, means: Array) -> tuple[Array, tuple[str, ...]]:
    """Standard deviations (N, 3) of the stored `scales` (N, 3) of Gaussians at `means` (N, 3), and a note if they were
    stored without the logarithm.

    That is so if no scale is negative and, read as logarithms, half of the Gaussians would cover the whole object.
    """
    with np.errstate(over="ignore"):
        usual: Array = np.exp(scales)
    sound = np.isfinite(means).all(axis=1) & ~np.isnan(scales).any(axis=1)
    given = scales[sound]
    given = given[:, np.isfinite(given).any(axis=0)] if len(given) >= ENOUGH else given[:0]
    if not given.size or given.min() < 0 or not given.max() > 0:
        return usual, ()
    size = float(np.ptp(np.quantile(means[sound], (0.01, 0.99), axis=0), axis=0).max())
    as_logs, as_is = (float(np.median(v.max(axis=1))) for v in (np.exp(np.minimum(given, 50.0)), given))
    if not as_logs > COVERING * size > as_is:
        return usual, ()
    note = (
        "No scale of the file is negative, so they were read as standard deviations, not as logarithms: as logarithms "
        f"half of the Gaussians would be wider than {as_logs / size:.1g} times the object."
    )
    return np.where(np.isneginf(scales), 0.0, scales), (note,)


def opacities(logits: Array) -> tuple[Array, tuple[str, ...]]:
    """Opacities in [0, 1], (N,), of the stored `logits` (N,), and a note if they were stored as they are.

    That is so if all lie in [0, 1] and some are near 1: as logits all opacities would lie between 0.5 and 0.73.
    """
    known = logits[~np.isnan(logits)]
    if len(known) >= ENOUGH and known.min() >= 0 and SURE <= known.max() <= 1:
        note = (
            "All opacities of the file lie between 0 and 1, so they were read as they are, not as logits: as logits "
            "none would be below 0.5 or above 0.73."
        )
        return logits, (note,)
    out = 1 / (1 + np.exp(-np.clip(logits, -50, 50)))
    return np.where(np.isneginf(logits), 0.0, out), ()
