"""How conditions become channels, and what is left out at random in training."""

from dataclasses import dataclass

from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Conditioning:
    """How force, material and fracture become channels of the network's input."""

    height: str = knob("tile", "tile: repeated beside every map; rgb_only: zeros beside the maps",
                       choices=("tile", "rgb_only"))  # fmt: skip
    gain: float = knob(1.0, "factor of the numbers of material and fracture where they enter the network: 1 = as in "
                       "the paper, whose thresholds differ by 0.33 at most, which a short training hardly reads",
                       least=0, most=100)  # fmt: skip
    ranges: str = knob("warn", "numbers outside the paper's ranges: clamp, clamp and warn, or refuse",
                       choices=("clamp", "warn", "fail"))  # fmt: skip
    drop_text: float = knob(0.0, "share of training clips whose caption is left out", least=0, most=1)
    drop_reference: float = knob(0.0, "share of training clips whose reference picture is left out", least=0, most=1)

    def __post_init__(self) -> None:
        check(self, "conditioning")
