"""What a training will take, before anything is loaded: tokens, operations, hours, memory; and whether it fits."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fracgen.config.train import Recipe, TrainConfig
from fracgen.memory import remedies
from fracgen.memory.blank import Weights
from fracgen.memory.budget import Memory, counted, memory
from fracgen.memory.devices import GIB, Device, of_bytes
from fracgen.memory.flops import Flops, flops
from fracgen.memory.size import Clips, Size


@dataclass(frozen=True)
class Estimate:
    """What a stage takes on a device."""

    stage: int
    streams: tuple[str, ...]
    size: Size
    """Of a batch of one device."""
    weights: Weights
    flops: Flops
    """Of a clip."""
    memory: Memory
    clips: float
    """Clips that the stage goes through."""
    epoch: int
    """Clips of an epoch."""
    devices: int
    speed: float
    """Operations a second of a device."""

    @property
    def seconds(self) -> float:
        """Seconds of a clip on one device."""
        return self.flops.total / self.speed

    @property
    def epoch_hours(self) -> float:
        """Hours of an epoch on all devices."""
        return self.epoch * self.seconds / self.devices / 3600

    @property
    def hours(self) -> float:
        """Hours of the stage on all devices."""
        return self.clips * self.seconds / self.devices / 3600

    def sampling_seconds(self, steps: int, passes: int) -> float:
        """Seconds of a sampled clip on one device, without decoding: `passes` forward passes a step."""
        return steps * passes * self.flops.forward / self.speed


def stages(cfg: TrainConfig) -> list[tuple[int, Recipe]]:
    """The stages that a training goes through, with their numbers."""
    numbers = (1, 2, 3) if cfg.stage == "all" else (int(cfg.stage),)
    return [(n, recipe(cfg, n)) for n in numbers]


def recipe(cfg: TrainConfig, stage: int) -> Recipe:
    """The recipe of a stage."""
    found: Recipe = getattr(cfg.stages, f"stage{stage}")
    return found


def estimate(cfg: TrainConfig, stage: int, clips: Clips, device: Device) -> Estimate:
    """What a stage takes; raises ValueError for sizes that the layout does not allow, and for impossible settings."""
    r, trainer = recipe(cfg, stage), cfg.trainer
    streams = tuple(r.streams)
    size = clips.size(len(streams), trainer.batch)
    return Estimate(
        stage=stage,
        streams=streams,
        size=size,
        weights=counted(cfg, streams),
        flops=flops(cfg.model, clips.size(len(streams)), trainer.checkpointing),
        memory=memory(cfg, streams, size, device),
        clips=r.steps * trainer.effective_batch if r.steps else r.epochs * clips.number,
        epoch=clips.number,
        devices=max(1, trainer.devices) * trainer.nodes,
        speed=device.flops,
    )


def clips_of(about: Mapping[str, Any], number: int = 1) -> Clips:
    """The clips of a latent cache whose cache.json says `about`."""
    return Clips(about["width"], about["height"], about["frames"], number)


def check(cfg: TrainConfig, about: Mapping[str, Any], device_bytes: int) -> list[Estimate]:
    """What the stages of `cfg` take on a device of `device_bytes`, with the clips of a cache that says `about`.

    Raises ValueError when a stage cannot fit, naming the cheapest change that makes it fit.
    """
    clips, device = clips_of(about), of_bytes(device_bytes)
    found = [estimate(cfg, n, clips, device) for n, _ in stages(cfg)]
    for one in found:
        if not one.memory.fits:
            raise ValueError(refusal(cfg, one, clips, device))
    return found


def refusal(cfg: TrainConfig, one: Estimate, clips: Clips, device: Device) -> str:
    """The error for a stage that does not fit: what it needs, what there is, and the way out."""
    way_out = remedies.cheapest(cfg, one.streams, clips, device)
    advice = f"the cheapest change that makes it fit is {way_out}" if way_out else "no setting makes it fit"
    return (f"stage={one.stage} needs {one.memory.total / GIB:.1f} GiB on each device with {one.size.tokens} tokens a "
            f"clip of {clips.width} x {clips.height} px (trainer.batch={cfg.trainer.batch}, trainer.checkpointing="
            f"{cfg.trainer.checkpointing}, trainer.base_dtype={cfg.trainer.base_dtype}), but {device.name} has "
            f"{device.memory / GIB:.1f} GiB: {advice}.")  # fmt: skip
