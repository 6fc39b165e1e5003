"""The Lightning module of a stage: it wires data, noise, network, losses and optimiser, and holds no mathematics.

Shapes: B clips, S streams.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import torch
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim import Optimizer

from fracgen import flow
from fracgen.config.train import Recipe, TrainConfig
from fracgen.data.batch import Batch
from fracgen.denoiser import velocity
from fracgen.layout import split
from fracgen.losses import constitutive, flow_matching
from fracgen.losses.constitutive import Constitutive
from fracgen.memory import optimiser
from fracgen.model import FracTransformer
from fracgen.training import network, noising, schedule
from fracgen.training.noising import Noised

PASSES = "passes"
"""Entry of what a validation step gives."""


class Losses(NamedTuple):
    """The losses of a batch; without gradient but for `total`."""

    total: Tensor
    """What is minimised, a number."""
    streams: Tensor
    """Error of the velocity of each clip and stream, [B, S]."""
    flow: Tensor
    """Its weighted mean over streams, [B]."""
    constitutive: constitutive.Terms | None
    sigma: Tensor
    """Noise levels, [B]."""


class Module(LightningModule):
    """A stage of training; `transformer` is what `fracgen.model.adapter.prepare` has made trainable."""

    def __init__(self, cfg: TrainConfig, recipe: Recipe, transformer: FracTransformer, total: int) -> None:
        """`total` is the number of optimiser steps. Raises ValueError for a recipe that cannot be trained."""
        super().__init__()
        self.strict_loading = False  # a checkpoint has what is trained only
        self.cfg, self.recipe, self.total = cfg, recipe, total
        self.streams = tuple(recipe.streams)
        self.shares = flow_matching.weights(cfg.loss.map_weights, self.streams)
        self.transformer = transformer
        self.constitutive = _constitutive(cfg, recipe)
        self.window: list[tuple[Batch, Losses]] = []
        """Forward passes of this process since the last optimiser step, and their losses."""
        self.gradient_norm: Tensor | None = None
        """Of the last optimiser step, before it was clipped."""
        self.tokens = 0
        """Tokens of a clip."""
        self.guard: Callable[[Module], None] = lambda module: None
        """Called before each optimiser step; it raises to prevent it."""

    # Losses

    def draw(self, batch: Batch) -> Noised:
        """The batch at noise levels and with noise of its own."""
        cfg = self.cfg
        sigma = noising.levels(batch, cfg.loss, cfg.seed, cfg.trainer.effective_batch)
        conditions = noising.inputs(batch, cfg.conditioning, cfg.seed, train=True)
        return noising.noised(batch, noising.noise(batch, cfg.seed), sigma, conditions)

    def losses(self, batch: Batch, noised: Noised, step: int) -> Losses:
        """The losses of a batch in optimiser step `step`; the network runs in the precision of the trainer, the losses
        in float32."""
        predicted = velocity(self.transformer, noised.x, noised.sigma, noised.inputs)
        with torch.autocast(noised.x.device.type, enabled=False):
            streams = flow_matching.per_stream(predicted, noised.target, self.streams)
            errors = flow_matching.weighted(streams, self.shares)
            total, terms = errors.mean(), None
            if self.constitutive is not None:
                clean = split(flow.clean(noised.x, predicted.float(), noised.sigma), self.streams)
                detach = step < self.cfg.loss.detach_stress
                terms = self.constitutive(clean, batch.scalars, noised.sigma, detach)
                total = total + self.constitutive_weight(step) * terms.loss.mean()
                terms = terms._replace(loss=terms.loss.detach())
        return Losses(total, streams.detach(), errors.detach(), terms, noised.sigma)

    def constitutive_weight(self, step: int) -> float:
        """Weight of the constitutive loss in optimiser step `step`."""
        return self.cfg.loss.lambda_const * schedule.ramp(step, self.cfg.loss.ramp)

    # Hooks of Lightning

    def on_fit_start(self) -> None:
        """On its device, the network gets what depends on it."""
        network.settle(self.transformer, self.cfg, self.tokens)

    def on_train_batch_end(self, outputs: Any, batch: Batch, batch_idx: int) -> None:
        """After the callbacks: forget the forward passes of an optimiser step."""
        if len(self.window) == self.trainer.accumulate_grad_batches:
            self.window = []

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """The loss of a forward pass, a number without shape, of a batch of [B] clips."""
        losses = self.losses(batch, self.draw(batch), self.global_step)
        self.window.append((batch, losses._replace(total=losses.total.detach())))
        return self.cfg.trainer.context_parallel * losses.total  # each process has the gradient of its tokens only

    def validation_step(self, batch: Batch, batch_idx: int) -> dict[str, list[Losses]]:
        """The losses at noise levels (k + 1/2) / n, with the same noise each time."""
        n, noise = self.cfg.trainer.val_levels, noising.noise(batch, self.cfg.seed, validation=True)
        conditions = noising.inputs(batch, self.cfg.conditioning, self.cfg.seed, train=False)
        levels = (torch.full((len(batch.ids),), (k + 0.5) / n) for k in range(n))
        passes = [noising.noised(batch, noise, sigma, conditions) for sigma in levels]
        return {PASSES: [self.losses(batch, noised, self.global_step) for noised in passes]}

    def configure_optimizers(self) -> Optimizer:
        """AdamW; the maps of the constitutive loss have a learning rate of their own and no weight decay."""
        lr = self.recipe.lr
        mine = [(name, p) for name, p in self.transformer.named_parameters() if p.requires_grad]
        groups: list[dict[str, Any]] = [
            {"params": [p for name, p in mine if decays(name, p)], "lr": lr},
            {"params": [p for name, p in mine if not decays(name, p)], "lr": lr, "weight_decay": 0.0},
        ]
        if self.constitutive is not None:
            maps = list(self.constitutive.parameters())
            groups.append({"params": maps, "lr": self.cfg.loss.const_lr, "weight_decay": 0.0})
        return optimiser.build([{**g, "full_lr": g["lr"]} for g in groups if g["params"]], self.cfg.trainer)

    def on_before_optimizer_step(self, optimizer: Optimizer) -> None:
        """Limit the norm of the gradient, refuse one that is not finite, and set the learning rate of this step."""
        parameters = [p for _, p in self.trained()]
        self.gradient_norm = nn.utils.clip_grad_norm_(parameters, self.cfg.trainer.clip or float("inf")).detach()
        self.guard(self)
        factor = schedule.learning_rate(self.global_step, self.recipe.warmup, self.total)
        for group in optimizer.param_groups:
            group["lr"] = group["full_lr"] * factor

    # What is trained

    def trained(self) -> Iterator[tuple[str, nn.Parameter]]:
        """Names and parameters of what is trained, `transformer.` and `constitutive.` before their own names."""
        return ((name, p) for name, p in self.named_parameters() if p.requires_grad)


def decays(name: str, parameter: Tensor) -> bool:
    """Whether weight decay acts on a parameter, any shape: on matrices and kernels, not on biases, norms, modulations
    and embeddings of the maps."""
    return parameter.ndim > 1 and not name.endswith(("scale_shift_table", "map_embed"))


def _constitutive(cfg: TrainConfig, recipe: Recipe) -> Constitutive | None:
    """The constitutive loss of a stage; raises ValueError when the stage lacks a stream that it needs."""
    if not recipe.constitutive:
        return None
    missing = [name for name in constitutive.STREAMS if name not in recipe.streams]
    if missing:
        raise ValueError(f"stages: streams={recipe.streams} lacks {', '.join(missing)}, which the constitutive loss "
                         "needs: add them, or set constitutive=false for this stage.")  # fmt: skip
    return Constitutive(cfg.loss)
