"""The schema of `python -m fracgen.sample`."""

from dataclasses import dataclass, field

from fracgen.config.model import Encoders, Vae
from fracsim.scene.knob import check, knob

MAPS = ("flow", "strain", "stress", "damage")
ALL = "all"


@dataclass(kw_only=True)
class Sampler:
    """How noise becomes a clip; more steps are slower and nearer to what the network means."""

    solver: str = knob("unipc", "solver, a module of fracgen.sampling.solvers", package="fracgen.sampling.solvers")
    steps: int = knob(20, "steps; each is one call of the network, or two with guidance", least=1, most=1000)
    shift: float = knob(0.0, "shift of the noise levels; 0 = that of the training, another one is warned of",
                        least=0, most=100)  # fmt: skip
    guidance: float = knob(1.0, "weight of the caption: 1 = as it is, in one call a step; above 1 = more",
                           least=0, most=30)  # fmt: skip
    passes: str = knob("sequential", "the two calls of guidance: sequential, or batched: faster, with "
                       "twice the memory", choices=("sequential", "batched"))  # fmt: skip
    overwrite_first_latent: bool = knob(False, "put the picture in place of the first frame, beside showing it as the "
                                        "reference only")  # fmt: skip
    dtype: str = knob("auto", "type of the network's weights and of its arithmetic; auto = bfloat16 on a GPU",
                      choices=("auto", "float32", "bfloat16"))  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "sampler")


@dataclass(kw_only=True)
class Generated:
    """Where samples are written; never part of a sample's identity."""

    folder: str = knob("generated", "parent of the folders of samples; a sample that is there is not made again")
    overwrite: bool = knob(False, "make finished samples again")

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class SampleConfig:
    """One picture, or clips of a data set, to be pulled."""

    run: str = knob("", "folder of a training, as runs/stage3-0123456789ab")
    base: str = knob("", "folder of the base weights, if they lie elsewhere than in the training")
    image: str = knob("", "picture of an object, any file that Pillow reads")
    condition: str = knob("", "JSON file of the pull, with the fields of fracsim.scene.condition.Condition; its "
                          "positions belong to the picture as it is shown")  # fmt: skip
    fit: str = knob("fit", "a picture of another shape: fit it on a white canvas, or crop it",
                    choices=("fit", "crop"))  # fmt: skip
    cutout: str = knob("none", "show the object alone on white, as simulated clips do: a way to find it, a module of "
                               "fracsim.photo.cutouts or a file ./CUTOUT.py; none = keep the ground")  # fmt: skip
    mask: str = knob("", "instead of cutout: picture that is white on the object and black elsewhere")
    data: str = knob("", "instead of image and condition: folder of a data set, whose clips give both")
    split: str = knob("test", "split of the clips", choices=("train", "test", "none", ALL))
    objects: list[str] = knob([], "only clips of these objects; empty = all")
    limit: int = knob(0, "only the first clips; 0 = all", least=0)
    maps: list[str] = knob([ALL], "maps that are decoded and written; all = those of the run", choices=(*MAPS, ALL))
    scales: str = knob("unit", "values of flow, strain and stress: unit = in [0, 1] of an unknown scale; truth = in "
                       "their units, by the scale of the simulated clip", choices=("unit", "truth"))  # fmt: skip
    ranges: str = knob("warn", "numbers outside the paper's ranges: clamp, clamp and warn, or refuse",
                       choices=("clamp", "warn", "fail"))  # fmt: skip
    seed: int = knob(0, "seed of the noise", least=0, most=2**31 - 1)
    batch: int = knob(1, "clips that are sampled at once", least=1, most=1024)
    device: str = knob("auto", "where the networks run", choices=("auto", "cpu", "cuda", "mps"))
    sampler: Sampler = field(default_factory=Sampler)
    vae: Vae = field(default_factory=Vae)
    encoders: Encoders = field(default_factory=Encoders)
    output: Generated = field(default_factory=Generated)

    def __post_init__(self) -> None:
        check(self, "")
