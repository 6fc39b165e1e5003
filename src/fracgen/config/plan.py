"""The schema of `python -m fracgen.plan`: a training, and the device and the clips it is planned for."""

from dataclasses import dataclass, field

from fracgen.config.train import TrainConfig
from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Plan:
    """What a training is planned for; sizes and number of clips count only where data.folder holds no latent cache."""

    device: str = knob("h100", "device; h100 and a100 have 80 GB, 4090 has 24 GB, cpu is this machine",
                       choices=("h100", "a100", "4090", "cpu"))  # fmt: skip
    memory: float = knob(0.0, "its memory, if it is another one; 0 = that of the device", "GiB", least=0, most=1e5)
    tflops: float = knob(0.0, "speed that it keeps up, as python -m fracgen.bench step measures; 0 = assumed, for cpu "
                         "half that of a large matrix product", "TFLOP/s", least=0, most=1e5)  # fmt: skip
    width: int = knob(512, "width of a clip", "px", least=16, most=8192)
    height: int = knob(512, "height of a clip", "px", least=16, most=8192)
    frames: int = knob(81, "frames of a clip, 1 + 4 n", least=1, most=10001)
    clips: int = knob(4212, "clips of the training split", least=1)
    steps: int = knob(50, "sampling steps of a clip", least=1, most=10000)
    guided: bool = knob(True, "sampling passes each step twice, with and without the caption")

    def __post_init__(self) -> None:
        check(self, "plan")


@dataclass(kw_only=True)
class PlanConfig(TrainConfig):
    """A training to be planned."""

    plan: Plan = field(default_factory=Plan)
