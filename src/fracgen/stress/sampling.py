"""Cases of a sampling: steps, guidance, captions, pictures, conditions."""

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fracgen.stress.case import Case
from fracgen.stress.place import Place, sample
from fracsim.records import Array


def cases() -> list[Case]:
    """All of them."""
    return [*_settings(), *_pictures(), *_conditions()]


def _settings() -> list[Case]:
    def of(name: str, *overrides: str, slow: bool = False, refusal: str = "") -> Case:
        return Case(name, lambda p, f: sample(p, f, *overrides), refusal, slow=slow)

    return [
        of("one step, euler", "sampler.steps=1", "sampler.solver=euler", slow=True),
        of("one step, unipc", "sampler.steps=1", "sampler.solver=unipc"),
        of("1000 steps, unipc", "sampler.steps=1000", "sampler.solver=unipc", slow=True),
        of("guidance 30", "sampler.guidance=30", slow=True),
        of("guidance 0", "sampler.guidance=0", slow=True),
        of("guidance 30, bfloat16, both passes at once", "sampler.guidance=30", "sampler.dtype=bfloat16",
           "sampler.passes=batched"),
        of("shift 100", "sampler.shift=100", "sampler.steps=4", slow=True),
        of("shift 0.1", "sampler.shift=0.1", "sampler.steps=4", slow=True),
        of("the first frame in its place", "sampler.overwrite_first_latent=true", slow=True),
        of("no step", "sampler.steps=0", refusal=r"sampler\.steps=0"),
        of("guidance 31", "sampler.guidance=31", refusal=r"sampler\.guidance=31", slow=True),
    ]  # fmt: skip


def _pictures() -> list[Case]:
    def of(name: str, image: Image.Image, suffix: str = "png", refusal: str = "", slow: bool = False) -> Case:
        def work(place: Place, folder: Path) -> list[Array]:
            image.save(folder / f"given.{suffix}")
            return sample(place, folder, picture=folder / f"given.{suffix}")

        return Case(f"picture: {name}", work, refusal, slow=slow)

    deep = np.linspace(0, 65535, 32 * 32).reshape(32, 32).astype(np.uint16)
    return [
        of("1 pixel", Image.new("RGB", (1, 1)), refusal=r"image=.*1 x 1 px, which is too small"),
        of("16,384 x 16 pixels", Image.new("RGB", (16384, 16), "red"), slow=True),
        Case("picture: 16,384 x 16,384 pixels", huge, r"image=.*px, which is too large", slow=True),
        of("alpha only", Image.new("LA", (32, 32), (0, 0))),
        of("CMYK", Image.new("CMYK", (32, 32), (0, 255, 255, 0)), "jpg", slow=True),
        of("16 bits a channel", Image.fromarray(deep), slow=True),
        of("all black", Image.new("RGB", (32, 32)), slow=True),
    ]


def huge(place: Place, folder: Path) -> list[Array]:
    """A picture of 268 million pixels, black or white, so that it is quickly written."""
    Image.new("1", (16384, 16384)).save(folder / "given.png")
    return sample(place, folder, picture=folder / "given.png")


def _conditions() -> list[Case]:
    def of(name: str, *overrides: str, refusal: str = "", slow: bool = False, **condition: object) -> Case:
        return Case(
            f"condition: {name}", lambda p, f: sample(p, f, *overrides, condition=condition), refusal, slow=slow
        )

    far: dict[str, Any] = {"grips": [-2.0, -2.0, 3.0, 3.0], "velocity": [-100.0, 100.0, 100.0, -100.0]}
    wild: dict[str, Any] = {"E": 1e10, "nu": 0.5, "onset": 9.9, "crit": 10.0, "category": "high_stretch"}
    return [
        of("grips out of the picture", **far),
        of("both grips at one place, at rest", grips=[0.5] * 4, velocity=[0.0] * 4, slow=True),
        of("the largest numbers that are allowed", slow=True, **wild),
        of("these, where ranges are strict", "ranges=fail", refusal=r"condition\.E=1e\+10 is outside", **wild),
        of("a caption of 2000 words", caption="torn " * 2000),
        of("a caption without words", caption=" ", slow=True),
        of("a position that is no number", grips=[float("nan"), 0.5, 0.5, 0.5], refusal=r"condition.*grips"),
        of("a velocity without end", velocity=[float("inf"), 0, 0, 0], refusal=r"condition.*velocity"),
        of("crit below onset", onset=3.0, crit=2.0, refusal=r"condition\.crit=2"),
    ]
