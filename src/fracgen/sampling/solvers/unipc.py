"""UniPC of second order (Zhao et al. 2023) on x0 estimates: one call of the network a step, fewer steps than Euler.

It is that of diffusers, which keeps the levels in float32: results are good to about 1e-6.
"""

from typing import Any

from diffusers import UniPCMultistepScheduler
from torch import Tensor

from fracgen.sampling.solvers import Field


def solve(field: Field, x: Tensor, levels: Tensor) -> Tensor:
    """The latent at 0 from `x`, any shape, at levels[0]; `levels` fall to 0, [steps + 1] float64."""
    untyped: Any = UniPCMultistepScheduler
    scheduler = untyped(prediction_type="flow_prediction", use_flow_sigmas=True, solver_order=2)
    scheduler.set_timesteps(sigmas=levels[:-1].numpy().copy())
    scheduler.set_begin_index(0)  # not looked up by its rounded timestep: neighbours may round alike
    # A level of 1 has become 0.999999, since the logarithm of 1 - sigma is needed.
    for sigma, timestep in zip(scheduler.sigmas[:-1].tolist(), scheduler.timesteps, strict=True):
        (x,) = scheduler.step(field(x, sigma), timestep, x, return_dict=False)
    return x
