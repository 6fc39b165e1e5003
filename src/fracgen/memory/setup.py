"""All choices of memory and speed, in the order in which they go together."""

from fracgen.config.train import Trainer
from fracgen.memory.attention import set_backend
from fracgen.memory.checkpointing import set_mode
from fracgen.memory.compiling import compile_blocks
from fracgen.memory.offload import Offload, offload_blocks
from fracgen.memory.parallel import enable_context_parallel
from fracgen.memory.quantise import DTYPES, quantise_base
from fracgen.model import FracTransformer


def apply(transformer: FracTransformer, cfg: Trainer, device: str, tokens: int | None = None) -> Offload | None:
    """Do what `cfg` says to a transformer that `fracgen.model.adapter.prepare` has seen, for a `device` to come.

    Call it while the transformer is on the CPU: weights of offloaded blocks then never reach the device in one piece.
    `tokens` of a clip are needed for context parallelism. Returns the weights that wait, if any. Raises ValueError
    naming the field that cannot be met.
    """
    if cfg.base_dtype in DTYPES:
        quantise_base(transformer, cfg.base_dtype)
    enable_context_parallel(transformer, cfg.context_parallel, tokens)
    set_mode(transformer, cfg.checkpointing)
    set_backend(transformer, cfg.attention, device)
    waiting = offload_blocks(transformer, cfg.offload_blocks)
    if cfg.compile:
        compile_blocks(transformer, device)
    return waiting
