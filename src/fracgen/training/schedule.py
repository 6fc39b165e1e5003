"""What changes with the optimiser step: learning rate, weight of the constitutive loss; and how many steps there are.

All are functions of the step alone, so that a run that goes on has nothing to restore, and accumulation cannot shift
them.
"""

import math

from fracgen.config.train import Recipe, Trainer


def learning_rate(step: int, warmup: int, total: int) -> float:
    """Factor of the learning rate in optimiser step `step` = 0 ... total - 1: linear up to 1, then a cosine to 0."""
    if step < warmup:
        return (step + 1) / warmup
    return 0.5 * (1 + math.cos(math.pi * (step - warmup) / max(1, total - warmup)))


def ramp(step: int, steps: int) -> float:
    """Factor of the constitutive loss in optimiser step `step`: from 0 to 1 over `steps` steps."""
    return min(1.0, step / steps) if steps else 1.0


def total_steps(recipe: Recipe, steps_per_epoch: int) -> int:
    """Optimiser steps of a stage: as asked for, or those of the epochs, at least 1."""
    return recipe.steps or max(1, round(recipe.epochs * steps_per_epoch))


def accumulation(cfg: Trainer, processes: int) -> int:
    """Forward passes of a process in an optimiser step, so that the effective batch is what it should be.

    `processes` is the number of devices over all nodes. Raises ValueError when it does not come out even.
    """
    at_once = cfg.batch * processes
    if cfg.effective_batch % at_once == 0:
        return cfg.effective_batch // at_once
    batch = max(b for b in range(1, cfg.batch + 1) if cfg.effective_batch % (b * processes) == 0 or b == 1)
    fits = cfg.effective_batch % (batch * processes) == 0
    nearest = math.ceil(cfg.effective_batch / at_once) * at_once
    way = f"set trainer.batch={batch}, or" if fits else "use a number of devices that divides it, or set"
    raise ValueError(
        f"trainer.effective_batch={cfg.effective_batch} does not divide by devices x nodes x batch = {processes} x "
        f"{cfg.batch} = {at_once}: {way} trainer.effective_batch={nearest}."
    )
