"""Euler's method, of first order: one call of the network a step."""

from torch import Tensor

from fracgen.sampling.solvers import Field


def solve(field: Field, x: Tensor, levels: Tensor) -> Tensor:
    """The latent at levels[-1] from `x`, any shape, at levels[0]; `levels` fall, [steps + 1] float64."""
    now, *later = levels.tolist()
    for then in later:
        x = x + (then - now) * field(x, now)
        now = then
    return x
