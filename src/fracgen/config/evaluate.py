"""The schema of `python -m fracgen.evaluate`."""

from dataclasses import dataclass, field
from typing import Any

from fracgen.config.model import Vae
from fracsim.scene.knob import check, knob

CONTROLS = ("truth", "vae", "static", "twins", "axis")
"""What the numbers are to be read against; `fracgen.evaluation.controls` says what each is."""
GROUPS = ("class", "object", "axis", "speed", "onset", "crit", "E", "nu", "split")
"""What clips can be grouped by; CSV files may bring more."""


@dataclass(kw_only=True)
class Scores:
    """Where results are written."""

    folder: str = knob("", "folder of the results and of the observations that they are made of; empty = the folder "
                       "evaluation in pred, or outputs/evaluation for a CSV file")  # fmt: skip
    overwrite: bool = knob(False, "observe all clips again")

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class EvaluateConfig:
    """Clips, the true ones, and what is measured."""

    pred: str = knob("", "what is scored: a folder of samples or of videos, or a CSV file with columns pred and gt")
    gt: str = knob("", "the true clips: a folder of samples or of videos; empty = only what needs no true clip")
    metric: dict[str, Any] = knob({}, "metrics by name with their fields, chosen by metric=[psnr,sac]; conf/metric "
                                  "has a file for each")  # fmt: skip
    outside: list[str] = knob([], "metrics from outside: paths of .py files, or names of entry points; their fields "
                              "are set by +metric.NAME.FIELD=VALUE")  # fmt: skip
    controls: list[str] = knob(list(CONTROLS), "what the numbers are read against: the true clip itself, through "
                               "the VAE (if vae.path is given), standing still, its twins, and answers that know no "
                               "axis",
                               choices=CONTROLS)  # fmt: skip
    control_clips: int = knob(8, "clips, evenly spread, of which controls are made; 0 = all", least=0)
    by: list[str] = knob(["class", "object", "axis"], "results are also given for each value of these")
    limit: int = knob(0, "only the first clips; 0 = all", least=0)
    alignment: str = knob("select", "which true frame belongs to a predicted one: select = as the training chose them, "
                          "time = the nearest in time, spread = the true clip evenly spread over the predicted one",
                          choices=("select", "time", "spread"))  # fmt: skip
    frame_select: str = knob("auto", "frames of a longer true clip: the first, the last, or evenly spread; auto = as "
                             "the sample says, and else both must be of equal length",
                             choices=("auto", "head", "tail", "linspace"))  # fmt: skip
    fps: float = knob(0.0, "frames a second of simulated time of predicted video files; 0 = that of the true clip",
                      "1/s", least=0)  # fmt: skip
    resize: str = knob("whole", "the larger clip is averaged over squares of pixels: only by whole factors, or by any "
                       "factor where the shapes agree", choices=("whole", "any"))  # fmt: skip
    percentile: float = knob(99.5, "flow, strain and stress of a simulated clip are scaled by this percentile of its "
                             "foreground, as python -m fracgen.encode does", least=1, most=100)  # fmt: skip
    suspect: bool = knob(False, "also clips whose numbers are not to be trusted")
    missing_weights: str = knob("skip", "metrics whose weights are missing: say so and compute the others, or stop",
                                choices=("skip", "error"))  # fmt: skip
    strict: bool = knob(False, "exit status 2 when a clip cannot be scored; the others are scored all the same")
    resamples: int = knob(1000, "resamples of the clips for the 95 % intervals; 0 = no intervals", least=0, most=10**6)
    seed: int = knob(0, "seed of the resamples", least=0, most=2**31 - 1)
    workers: int = knob(1, "processes that observe", least=1, most=256)
    plots: bool = knob(True, "draw the results")
    logger: str = knob("none", "wandb: a table and the plots as a run of wandb, offline without a key; all of it lies "
                       "on disk too", choices=("none", "wandb"))  # fmt: skip
    project: str = knob("fracgen", "project of wandb")
    vae: Vae = field(default_factory=Vae)
    output: Scores = field(default_factory=Scores)

    def __post_init__(self) -> None:
        check(self, "")
