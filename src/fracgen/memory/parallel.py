"""Context parallelism: GPUs share the tokens of one clip (Ulysses, Jacobs et al. 2023), by diffusers. Never run here.

It needs several CUDA devices, which the developers did not have, so no test has run it; what is tested is what refuses
it. Compare a few losses with those of one GPU before trusting it.
"""

import warnings
from typing import Any

import diffusers
import torch

from fracgen.model import FracTransformer


def check(degree: int, heads: int, tokens: int | None = None) -> None:
    """Raise ValueError unless `degree` GPUs can share attention of so many heads, and clips of so many tokens."""
    allowed = [n for n in range(1, heads + 1) if heads % n == 0]
    if degree not in allowed:
        raise ValueError(f"trainer.context_parallel={degree} must divide the {heads} heads of attention: it may be "
                         f"{', '.join(map(str, allowed))}.")  # fmt: skip
    if tokens is not None and tokens % degree:
        raise ValueError(f"trainer.context_parallel={degree} must divide the {tokens} tokens of a clip, those of the "
                         "reference among them: change the size of the pictures, or the number of GPUs.")  # fmt: skip


def enable_context_parallel(transformer: FracTransformer, degree: int, tokens: int | None = None) -> None:
    """Share every clip among `degree` GPUs; warns that this is untested. 1 changes nothing.

    Raises ValueError if there is no CUDA, torch.distributed has not been started, or `check` refuses.
    """
    if degree == 1:
        return
    network: Any = transformer
    check(degree, network.config.num_attention_heads, tokens)
    if not torch.cuda.is_available():
        raise ValueError(f"trainer.context_parallel={degree} needs CUDA devices, and this machine has none: set "
                         "trainer.context_parallel=1.")  # fmt: skip
    if not torch.distributed.is_initialized():
        raise ValueError(f"trainer.context_parallel={degree} needs {degree} processes: set trainer.devices={degree}.")
    warnings.warn("trainer.context_parallel is untested: compare a few losses with those of one GPU.", stacklevel=2)
    config: Any = diffusers.ContextParallelConfig
    network.enable_parallelism(config=config(ulysses_degree=degree))
