"""The schema of `python -m fracgen.train`."""

from dataclasses import dataclass, field
from typing import Any

from fracgen.config.conditioning import Conditioning
from fracgen.config.model import Model, Vae
from fracgen.layout import STREAMS, ordered
from fracsim.scene.knob import check, knob

LARGE = 200_000_000
"""Parameters above which random weights are refused: so many do not learn video from a few thousand clips."""

LARGE_VAE = 32
"""vae.base_dim above which a VAE is the released one, whose weights must be given."""


@dataclass(kw_only=True)
class Recipe:
    """One stage."""

    streams: list[str] = knob(list(STREAMS), "what is predicted, rgb among it", choices=STREAMS)
    constitutive: bool = knob(False, "add the constitutive loss (Eq. 9 of the paper)")
    epochs: float = knob(3.0, "passes over the training clips", least=0, open="least")
    steps: int = knob(0, "optimiser steps; 0 = as many as the epochs take", least=0)
    lr: float = knob(1e-4, "learning rate after the warm-up", least=0, open="least", most=1.0)
    warmup: int = knob(40, "optimiser steps until the learning rate is reached", least=0)

    def __post_init__(self) -> None:
        check(self, "stages.stageN")
        self.streams = list(ordered(self.streams))


@dataclass(kw_only=True)
class Stages:
    """The three stages of the paper: colour, colour and maps, and these with the constitutive loss."""

    stage1: Recipe = field(default_factory=lambda: Recipe(streams=["rgb"]))
    stage2: Recipe = field(default_factory=Recipe)
    stage3: Recipe = field(default_factory=lambda: Recipe(constitutive=True, epochs=2.0))


@dataclass(kw_only=True)
class Data:
    """The latent cache that `python -m fracgen.encode` has made."""

    folder: str = knob("latents", "folder of the latent cache")
    train_split: str = knob("train", "split to train on; all = also on the objects that are held out for tests",
                            choices=("train", "test", "none", "all"))  # fmt: skip
    val_split: str = knob("test", "split to validate on", choices=("train", "test", "none"))
    objects: list[str] = knob([], "only clips of these objects; empty = all")
    limit: int = knob(0, "only the first clips of the training split; 0 = all", least=0)
    val_limit: int = knob(32, "clips of the validation; 0 = all", least=0)
    workers: int = knob(2, "processes that read", least=0, most=256)

    def __post_init__(self) -> None:
        check(self, "data")


@dataclass(kw_only=True)
class Loss:
    """Flow matching, and the constitutive regulariser in latent space."""

    shift: float = knob(
        5.0, "shift of the noise levels; 1 draws them uniformly, as the paper writes", least=0.1, most=100
    )
    stratified: bool = knob(True, "spread the noise levels of one effective batch evenly over [0, 1]")
    map_weights: list[float] = knob([1.0, 1.0, 1.0, 1.0, 1.0], "weights of rgb, flow, strain, stress, damage",
                                    least=0)  # fmt: skip
    lambda_const: float = knob(0.1, "weight of the constitutive loss", least=0)
    ramp: int = knob(200, "optimiser steps over which that weight grows from 0", least=0)
    lame: str = knob("pwave", "Lame parameters over the P-wave modulus (in [0, 1]), over E, or in Pa",
                     choices=("pwave", "E", "raw"))  # fmt: skip
    weight: str = knob("clean", "w(t): clean = (1 - sigma)^2, ratio = (1 - sigma)^2 / ((1 - sigma)^2 + sigma^2), "
                       "none = 1", choices=("clean", "ratio", "none"))  # fmt: skip
    gate: str = knob("sigmoid", "gate from the damage latent: its sigmoid, or that of a learned affine map of it",
                     choices=("sigmoid", "affine"))  # fmt: skip
    detach_stress: int = knob(0, "optimiser steps during which the constitutive loss trains its own maps only", least=0)
    const_lr: float = knob(
        1e-3, "learning rate of the maps f and g, without weight decay", least=0, open="least", most=1
    )

    def __post_init__(self) -> None:
        check(self, "loss")
        if len(self.map_weights) != len(STREAMS) or not any(self.map_weights):
            raise ValueError(f"loss.map_weights={self.map_weights} must have {len(STREAMS)} numbers, not all 0: one "
                             f"for each of {', '.join(STREAMS)}.")  # fmt: skip


@dataclass(kw_only=True)
class Trainer:
    """How the optimiser runs, and where."""

    accelerator: str = knob("auto", "device", choices=("auto", "cpu", "gpu", "mps"))
    devices: int = knob(1, "devices of this machine; 0 = all", least=0, most=1024)
    nodes: int = knob(1, "machines", least=1, most=1024)
    precision: str = knob("bf16-mixed", "arithmetic of the forward pass", choices=("32-true", "bf16-mixed"))
    base_dtype: str = knob("bfloat16", "type of frozen weights; float8 and int8 halve their memory",
                           choices=("float32", "bfloat16", "float8", "int8"))  # fmt: skip
    batch: int = knob(1, "clips of one forward pass of a device", least=1, most=4096)
    effective_batch: int = knob(
        16, "clips of an optimiser step, over all devices and accumulation", least=1, most=65536
    )
    optimizer: str = knob("adamw", "adamw, or adamw8bit with states of 8 bit", choices=("adamw", "adamw8bit"))
    weight_decay: float = knob(0.01, "weight decay", least=0, most=1)
    clip: float = knob(1.0, "largest norm of the gradient; 0 = no limit", least=0)
    checkpointing: str = knob("full", "recompute activations in the backward pass: none, full, or selective, which "
                              "keeps the outputs of self-attention", choices=("none", "full", "selective"))  # fmt: skip
    attention: str = knob("native", "back-end of attention, as diffusers names them: native, flash, _native_cudnn, ...")
    compile: bool = knob(False, "compile the blocks of the transformer")
    offload_blocks: int = knob(0, "blocks whose frozen weights wait in the memory of the host", least=0, most=1000)
    context_parallel: int = knob(1, "GPUs that share one clip (CUDA only; untested here)", least=1, most=64)
    ema: float = knob(0.0, "decay of averaged weights; 0 = none", least=0, most=0.99999)
    save_minutes: float = knob(30.0, "minutes between checkpoints", least=0.01)
    save_steps: int = knob(250, "optimiser steps between checkpoints", least=1)
    val_steps: int = knob(250, "optimiser steps between validations; 0 = none", least=0)
    val_levels: int = knob(5, "noise levels at which the validation judges each clip", least=1, most=100)
    profile_steps: int = knob(0, "optimiser steps at the end that are profiled; 0 = none", least=0)
    log_steps: int = knob(10, "optimiser steps between log entries", least=1)

    def __post_init__(self) -> None:
        check(self, "trainer")


@dataclass(kw_only=True)
class Logger:
    """Where curves and videos go."""

    kind: str = knob("csv", "csv: files in the folder of the run; wandb (offline without a key) and tensorboard beside "
                     "it; none", choices=("csv", "wandb", "tensorboard", "none"))  # fmt: skip
    project: str = knob("fracgen", "project of wandb")
    group: str = knob("", "group of wandb; empty = the name of the experiment")
    videos: int = knob(4, "clips of the validation that are sampled and shown at each validation; 0 = none; they need "
                       "the VAE of the cache", least=0, most=64)  # fmt: skip
    video_steps: int = knob(20, "sampling steps of these, and of the clips of `measure`", least=1, most=1000)

    def __post_init__(self) -> None:
        check(self, "logger")


@dataclass(kw_only=True)
class Measure:
    """Metrics of sampled clips of the validation; truth is what the VAE decodes of the cache."""

    outside: list[str] = knob([], "metrics from outside beside those of metric=[...]: paths of .py files, or names of "
                              "entry points", package="fracgen.metrics")  # fmt: skip
    clips: int = knob(4, "clips of the validation that are measured, among them those of the videos; 0 = none; they "
                      "need the VAE of the cache", least=0, most=4096)  # fmt: skip
    every_n_val: int = knob(1, "validations between measurements; the last one always measures", least=1)

    def __post_init__(self) -> None:
        check(self, "measure")


@dataclass(kw_only=True)
class Runs:
    """Where runs lie; a run is a folder stageN-<id>, named by a hash of all that shapes its weights."""

    folder: str = knob("runs", "parent of the folders of runs")
    overwrite: bool = knob(False, "repeat a finished run")

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class TrainConfig:
    """One training: a stage of the paper, or all three in turn."""

    stage: int | str = knob(1, "1: colour; 2: colour and maps; 3: with the constitutive loss; all: one after the other",
                            least=1, most=3, choices=("all",))  # fmt: skip
    init_from: str = knob(
        "auto", "weights to start from: the run of the stage before (auto), a folder of a run, or none"
    )
    name: str = knob("", "name of the experiment (a label)")
    replay: str = knob("", "file nan-STEP.safetensors of a run that stopped: compute its step again and say what is "
                       "not finite")  # fmt: skip
    seed: int = knob(0, "seed of weights, order, noise and noise levels", least=0, most=2**31 - 1)
    model: Model = field(default_factory=Model)
    vae: Vae = field(default_factory=Vae)
    conditioning: Conditioning = field(default_factory=Conditioning)
    data: Data = field(default_factory=Data)
    loss: Loss = field(default_factory=Loss)
    stages: Stages = field(default_factory=Stages)
    trainer: Trainer = field(default_factory=Trainer)
    logger: Logger = field(default_factory=Logger)
    measure: Measure = field(default_factory=Measure)
    metric: dict[str, Any] = knob({}, "metrics of clips of the validation, by name with their fields, chosen by "
                                  "metric=[psnr,sac]; conf/metric has a file for each")  # fmt: skip
    output: Runs = field(default_factory=Runs)

    def __post_init__(self) -> None:
        check(self, "")
        t = self.trainer
        if self.model.train == "lora" and t.precision == "32-true" and t.base_dtype != "float32":
            raise ValueError(f"trainer.base_dtype={t.base_dtype} needs trainer.precision=bf16-mixed, which lets "
                             "frozen weights have another type than float32: set it, or trainer.base_dtype="
                             "float32.")  # fmt: skip
        if t.compile and t.offload_blocks:
            raise ValueError(f"trainer.offload_blocks={t.offload_blocks} does not go with compiled blocks: set "
                             "trainer.compile=false.")  # fmt: skip


def check_weights(model: Model) -> None:
    """Raise ValueError when a large model has no weights to start from."""
    dim = model.heads * model.head_dim
    parameters = model.layers * (8 * dim**2 + 2 * dim * model.ffn_dim)  # two attentions and the feed-forward
    if not model.path and parameters > LARGE:
        raise ValueError("model.path is missing: set it to the folder of the weights of "
                         "Wan2.1-Fun-V1.1-1.3B-Control, as model.path=weights/Wan2.1-Fun-V1.1-1.3B-Control. Without "
                         "weights, model=tiny trains a small model from random ones.")  # fmt: skip
