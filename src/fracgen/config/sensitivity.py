"""The schema of `python -m fracgen.sensitivity`."""

from dataclasses import dataclass, field
from typing import Any

from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Tables:
    """Where the tables are written."""

    folder: str = knob("outputs/sensitivity_table", "folder of sensitivity.csv and sensitivity.md")

    def __post_init__(self) -> None:
        check(self, "output")


@dataclass(kw_only=True)
class SensitivityConfig:
    """True clips, what is done to them, and what is measured."""

    data: str = knob("", "folder of a data set of simulated clips, as of python -m fracsim +sweep=sensitivity")
    metric: dict[str, Any] = knob({}, "metrics by name with their fields, chosen by metric=[psnr,sac]; conf/metric "
                                  "has a file for each")  # fmt: skip
    outside: list[str] = knob([], "metrics from outside: paths of .py files, or names of entry points",
                              package="fracgen.metrics")  # fmt: skip
    limit: int = knob(0, "only the first clips are altered; 0 = all", least=0)
    blur: float = knob(0.02, "standard deviation of the blur, as a part of the picture's width", least=0, most=1)
    noise: float = knob(0.05, "standard deviation of the noise, as a part of the range of values", least=0, most=1)
    shift: float = knob(0.15, "delay of the clips that come late, as a part of their length", least=0, most=1)
    seed: int = knob(0, "seed of the noise", least=0, most=2**31 - 1)
    output: Tables = field(default_factory=Tables)

    def __post_init__(self) -> None:
        check(self, "")
