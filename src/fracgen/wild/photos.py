"""The photos of a folder and the pull on each: its own condition file, or a plain one."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fracsim.photo.outline import outline
from fracsim.scene import condition
from fracsim.scene.classes import LAWS
from fracsim.scene.condition import Condition
from fracsim.scene.program import compose
from fracsim.scene.vocab import Asset, Scene

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".heic", ".heif", ".avif", ".bmp", ".tif", ".tiff")
PRESETS = {"bread": ("bread", "bread"), "rubber": ("rubber", "rubber")}
"""Files of conf/material and conf/fracture by the name of a preset."""


@dataclass(frozen=True)
class Pulled:
    """A photo and the condition file of the pull on it."""

    photo: Path
    condition: Path

    @property
    def mask(self) -> Path | None:
        """The object's outline, NAME.mask.png beside the photo, if it is there."""
        path = self.photo.with_suffix(".mask.png")
        return path if path.is_file() else None


def found(folder: Path) -> list[Path]:
    """The photos of a folder by name, without masks; raises ValueError if there is none."""
    if not folder.is_dir():
        raise ValueError(f"{folder} is not a folder, seen from {Path.cwd()}: give one with photos.")
    photos = sorted(p for p in folder.iterdir() if p.suffix.lower() in SUFFIXES and not p.stem.endswith(".mask"))
    if not photos:
        raise ValueError(f"{folder} holds no photo: give a folder of {', '.join(SUFFIXES[:4])} or the like.")
    return photos


def pulled(photo: Path, folder: Path, preset: str) -> Pulled:
    """A photo with NAME.json beside it or, if there is none, with a plain pull that is written into `folder`.

    Raises ValueError when the photo cannot be used.
    """
    beside = photo.with_suffix(".json")
    if beside.is_file():
        return Pulled(photo, beside)
    written = folder / f"{photo.stem}.json"
    mask = photo.with_suffix(".mask.png")
    given = plain(photo, str(mask) if mask.is_file() else "", preset)
    folder.mkdir(parents=True, exist_ok=True)
    condition.save(given, written)
    return Pulled(photo, written)


def plain(photo: Path, mask: str, preset: str) -> Condition:
    """The default pull, along image right, on the object in a photo, with material and thresholds of a preset."""
    material, fracture = PRESETS[preset]
    scene: Scene = compose(f"material={material}", f"fracture={fracture}")
    seen = outline(Asset(kind="image", path=str(photo), mask=mask))
    load, size = scene.loading, np.array(seen.photo.size, float)
    scale = seen.extent / scene.asset.size
    reach, speed = (np.array([scale * value, 0.0]) / size for value in (load.offset, load.speed))
    centre = seen.centre / size
    return Condition(
        E=scene.material.E, nu=scene.material.nu, category=LAWS[scene.material.law], onset=scene.fracture.onset,
        crit=scene.fracture.crit, fps=scene.capture.fps,
        grips=[*(centre - reach), *(centre + reach)], velocity=[*(-speed), *speed],
    )  # fmt: skip
