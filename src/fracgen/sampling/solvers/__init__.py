"""Solvers of dx / dsigma = v(x, sigma) from noise (sigma = 1) to data (sigma = 0); one module each, chosen by name.

A module has `solve(field, x, levels) -> x`. A new solver, also one of few steps, is one file here.
"""

from collections.abc import Callable
from typing import Protocol, cast

from torch import Tensor

from fracsim import registry

Field = Callable[[Tensor, float], Tensor]
"""The velocity noise - x0 at a latent of any shape and a noise level in [0, 1], in shape and type of the latent."""


class Solver(Protocol):
    """What a module of this package offers."""

    def solve(self, field: Field, x: Tensor, levels: Tensor) -> Tensor:
        """The latent at levels[-1] from `x`, any shape, at levels[0]; `levels` fall, [steps + 1] float64."""
        ...


def load(name: str) -> Solver:
    """The solver `name`; raises ValueError naming those there are."""
    return cast(Solver, registry.load(__name__, name, "sampler.solver"))
