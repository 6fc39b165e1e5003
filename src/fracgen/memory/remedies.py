"""The cheapest change that makes a training fit into a device."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, NamedTuple

from fracgen.config.train import TrainConfig
from fracgen.layout import MULTIPLE
from fracgen.memory.budget import Memory, memory
from fracgen.memory.devices import GIB, Device
from fracgen.memory.size import Clips

ORDER = ("none", "selective", "full")
"""Checkpointing, from the fastest to the one that keeps least."""


class Case(NamedTuple):
    """A training of some streams on clips of a size, and what was changed to get there."""

    cfg: TrainConfig
    streams: tuple[str, ...]
    clips: Clips
    changes: tuple[str, ...] = ()

    def memory(self, device: Device) -> Memory:
        """What it needs."""
        return memory(self.cfg, self.streams, self.clips.size(len(self.streams), self.cfg.trainer.batch), device)

    def trainer(self, **fields: Any) -> "Case":
        """With other fields of the section trainer."""
        texts = tuple(f"trainer.{name}={value}" for name, value in fields.items())
        return self._replace(cfg=replace(self.cfg, trainer=replace(self.cfg.trainer, **fields)),
                             changes=(*self.changes, *texts))  # fmt: skip


class Remedy(NamedTuple):
    """Changes that make a training fit, as overrides, and the bytes that it then needs."""

    changes: tuple[str, ...]
    total: int

    def __str__(self) -> str:
        return f"{' '.join(self.changes)}, which needs {self.total / GIB:.1f} GiB"


def cheapest(cfg: TrainConfig, streams: Sequence[str], clips: Clips, device: Device) -> Remedy | None:
    """The cheapest changes that make a training fit; None when nothing does.

    Kinds of changes are tried one by one in the order of their cost, which is a batch that is accumulated instead, time
    for recomputing, precision, time for copies. Then they are added up; then the picture is made smaller, alone, and at
    last beside all of them.
    """
    start = Case(cfg, tuple(streams), clips)
    alone = (case for kind in KINDS for case in kind(start))
    together = list(_together(start))
    last = together[-1] if together else start
    for case in chain(alone, together, _smaller(start, device), _smaller(last, device)):
        if case.memory(device).fits:
            return Remedy(case.changes, case.memory(device).total)
    return None


def _together(case: Case) -> Iterator[Case]:
    """More and more changes, of each kind up to the last one."""
    for kind in KINDS:
        for case in kind(case):  # noqa: B020, the last one of a kind stays
            yield case


def _batch(case: Case) -> Iterator[Case]:
    """Fewer clips in a forward pass, the same in an optimiser step."""
    trainer = case.cfg.trainer
    for batch in range(trainer.batch - 1, 0, -1):
        if trainer.effective_batch % (batch * max(1, trainer.devices) * trainer.nodes) == 0:
            yield case.trainer(batch=batch)


def _checkpointing(case: Case) -> Iterator[Case]:
    for mode in ORDER[ORDER.index(case.cfg.trainer.checkpointing) + 1 :]:
        yield case.trainer(checkpointing=mode)


def _optimiser(case: Case) -> Iterator[Case]:
    if case.cfg.trainer.optimizer == "adamw":
        yield case.trainer(optimizer="adamw8bit")


def _base(case: Case) -> Iterator[Case]:
    """Frozen weights of fewer bits, which go with mixed precision; none are frozen where all weights are trained."""
    if case.cfg.model.train == "lora" and case.cfg.trainer.precision == "bf16-mixed":
        for dtype in {"float32": ("bfloat16", "int8"), "bfloat16": ("int8",)}.get(case.cfg.trainer.base_dtype, ()):
            yield case.trainer(base_dtype=dtype)


def _offload(case: Case) -> Iterator[Case]:
    """Frozen weights of more and more blocks in the memory of the host, which goes with checkpointing only."""
    trainer, layers = case.cfg.trainer, case.cfg.model.layers
    if case.cfg.model.train != "lora" or trainer.checkpointing == "none" or trainer.compile:
        return
    for blocks in sorted({round(layers * share / 5) for share in range(1, 6)}):
        if blocks > trainer.offload_blocks:
            yield case.trainer(offload_blocks=blocks)


KINDS = (_batch, _checkpointing, _optimiser, _base, _offload)
"""Kinds of changes to a training on the same clips, in the order of their cost."""


def _smaller(case: Case, device: Device) -> Iterator[Case]:
    """Smaller pictures of about the same shape, which means that the data set is encoded again.

    Activations grow with the tokens, so that the largest one that fits is among the first.
    """
    need = case.memory(device)
    activations = need.kept + need.inside
    room = need.capacity - (need.total - activations)
    width, height = case.clips.width, case.clips.height
    columns = int(width / MULTIPLE * (room / activations) ** 0.5) if room > 0 else 0
    for count in range(min(columns + 1, width // MULTIPLE - 1), max(0, columns - 3), -1):
        size = count * MULTIPLE, max(1, round(height * count / width)) * MULTIPLE
        yield case._replace(clips=Clips(*size, *case.clips[2:]),
                            changes=(*case.changes, f"width={size[0]}", f"height={size[1]}"))  # fmt: skip
