"""The axis along which points move apart, from their displacements (the paper's stretching axis).

Displacements are in pixels of a picture, x right and y down. Angles are in degrees, counter-clockwise from image right,
as `loading.axis_deg`, in [0, 180): an axis has no sign.
"""

from typing import NamedTuple

import numpy as np

from fracsim.records import Array


class Axis(NamedTuple):
    """A stretching axis, and what it rests on."""

    angle: float
    """Direction in [0, 180) [deg]; NaN when it is undefined."""
    confidence: float
    """c = 1 - lambda_min / lambda_max in [0, 1]; 0 when the axis is undefined."""
    seen: int
    """Points that are seen at the start and at the end."""
    moving: int
    """Those of them that move far enough to count."""

    @property
    def defined(self) -> bool:
        """Whether enough points move."""
        return not np.isnan(self.angle)


def stretching(start: Array, end: Array, visible: Array, tau: float, k: int) -> Axis:
    """The axis along which N points move apart between two frames.

    start, end (N, 2) are positions [px], visible (N,) bool says which points are seen in both frames; a position that
    is not finite counts as unseen. The mean displacement is removed; then points that move by less than `tau` [px]
    are dropped. With fewer than `k` left the axis is undefined.
    """
    finite = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    u = (np.asarray(end, np.float64) - start)[np.asarray(visible, bool) & finite]
    seen = len(u)
    u = u - u.mean(axis=0) if seen else u
    w = np.hypot(u[:, 0], u[:, 1])
    u, w = u[w >= tau], w[w >= tau]
    if len(w) < max(k, 1) or not w.sum():
        return Axis(np.nan, 0.0, seen, len(w))
    angle, confidence = principal(orientation(u, w))
    return Axis(angle, confidence, seen, len(w))


def orientation(u: Array, w: Array) -> Array:
    """Q = sum(w e e^T) / sum(w), (2, 2), of displacements u (N, 2) with lengths w (N,), e = u / w."""
    u, w = u[w > 0], w[w > 0]
    Q: Array = (u / w[:, None]).T @ u / w.sum()
    return Q


def principal(Q: Array) -> tuple[float, float]:
    """The angle [deg] of the larger eigenvector of a symmetric Q (2, 2) with x right and y down, and its confidence.

    Of Q with trace 1, lambda = (1 +- r) / 2 with r = hypot(Qxx - Qyy, 2 Qxy), so that c = 2 r / (1 + r).
    """
    difference, twice, trace = Q[0, 0] - Q[1, 1], 2 * Q[0, 1], Q[0, 0] + Q[1, 1]
    r = float(np.hypot(difference, twice) / trace)
    angle = float(np.degrees(np.arctan2(-twice, difference)) / 2 % 180)
    return angle % 180, min(2 * r / (1 + r), 1.0)


def between(a: float, b: float) -> float:
    """The angle between two axes in [0, 90] [deg], arccos |a . b| without its loss of digits near 0; NaN with NaN."""
    apart = abs(a - b) % 180
    return min(apart, 180 - apart) if apart == apart else float("nan")


def similarity(theta: float, sigma: float) -> float:
    """exp(-(theta / sigma)^2) of the angle between two axes, both in degrees."""
    return float(np.exp(-((theta / sigma) ** 2)))
