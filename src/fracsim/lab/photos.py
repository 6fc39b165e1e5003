"""python -m fracsim.lab.photos: the example photos in docs/photos, built-in objects on tables that are drawn.

They are made for this project, like its objects, and under its licence. What is in them is known only to whoever reads
this file: to the programs they are photos like others.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter

from fracsim import Run, compose
from fracsim.asset.procedural import noise
from fracsim.records import Array

FOLDER = Path("docs/photos")
SIZE = 768
"""Width and height of a photo [px]."""
SHARP = ("solver.cells=240", "solver.particles_per_axis=2", "capture.frames=1", "capture.maps=[]", "loading.speed=0.3",
         f"camera.width={SIZE}", f"camera.height={SIZE}")  # fmt: skip
QUALITY = 92
"""Of the JPEG files."""


def wood(P: Array) -> Array:
    """A board, rings that are cut lengthwise: colours (3, N) at points (3, N) of the table."""
    x, y = P[0], P[1]
    grain = np.sin(60 * (y + 0.25 * noise.fractal(np.stack([0.4 * x, 2 * y, P[2]]), 3, 1)))
    fibre = noise.fractal(np.stack([3 * x, 60 * y, P[2]]), 1, 2)
    shade = 0.5 + 0.18 * grain + 0.16 * fibre
    return np.stack([0.30 + 0.34 * shade, 0.19 + 0.24 * shade, 0.12 + 0.15 * shade])


def linen(P: Array) -> Array:
    """A grey-blue cloth with its weave and a few folds: colours (3, N) at points (3, N)."""
    weave = 0.03 * (np.sin(260 * P[0]) + np.sin(260 * P[1]))
    fold = 0.10 * noise.fractal(P, 2.2, 3)
    shade = 0.62 + weave + fold + 0.04 * noise.value(P, 90, 4)
    return np.stack([0.78 * shade, 0.88 * shade, 1.02 * shade])


def marble(P: Array) -> Array:
    """White stone with grey veins: colours (3, N) at points (3, N)."""
    vein = np.abs(noise.fractal(P, 2.5, 5, octaves=5))
    shade = 0.92 - 0.35 * np.exp(-((vein / 0.05) ** 2)) + 0.03 * noise.fractal(P, 9, 6)
    return np.stack([shade, shade, 1.02 * shade])


def slate(P: Array) -> Array:
    """Dark stone, split and a little dusty: colours (3, N) at points (3, N)."""
    shade = 0.20 + 0.06 * noise.fractal(P, 5, 7, octaves=5) + 0.03 * noise.value(P, 70, 8)
    return np.stack([0.95 * shade, shade, 1.1 * shade])


def sand(P: Array) -> Array:
    """A beach in the sun: colours (3, N) at points (3, N)."""
    shade = 0.80 + 0.10 * noise.fractal(P, 4, 9) + 0.07 * noise.value(P, 160, 10) + 0.05 * noise.value(P, 60, 11)
    return np.stack([1.02 * shade, 0.90 * shade, 0.70 * shade])


class Shot(NamedTuple):
    """One photo."""

    object: str
    table: Callable[[Array], Array]
    turn: float = 0.0
    """Of the object about the line of sight [deg]."""


SHOTS = {
    "croissant": Shot("croissant", wood, 12), "cake": Shot("cake", slate), "bear": Shot("bear", linen, -8),
    "starfish": Shot("star", sand, 20), "roll": Shot("bread_roll", marble),
}  # fmt: skip


def photo(shot: Shot) -> Array:
    """A photo, (SIZE, SIZE, 3) uint8: the table, the object's soft shadow, the object, the grain of a sensor."""
    run = Run(compose(f"asset={shot.object}", f"asset.rotate_deg=[0,0,{shot.turn:g}]", *SHARP))
    colour, alpha = run.render(next(run.frames()))
    y, x = (np.mgrid[0:SIZE, 0:SIZE].reshape(2, -1) / SIZE).astype(np.float32)
    table = shot.table(np.stack([x, y, np.zeros_like(x)])).T.reshape(SIZE, SIZE, 3)
    window = 1.12 - 0.30 * np.hypot(x - 0.2, y - 0.15).reshape(SIZE, SIZE)
    shadow = gaussian_filter(np.roll(alpha, (round(0.035 * SIZE), round(0.025 * SIZE)), axis=(0, 1)), 0.02 * SIZE)
    ground = table * (window * (1 - 0.55 * shadow))[..., None]
    picture = colour + (1 - alpha[..., None]) * ground
    grain = np.random.default_rng(0).normal(0, 0.008, picture.shape)
    return np.asarray(np.rint(255 * np.clip(picture + grain, 0, 1)), np.uint8)


def main() -> None:
    """Write all photos."""
    if not Path("pyproject.toml").exists():
        sys.exit("error: run this in the repository, whose docs/photos it writes")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, shot in SHOTS.items():
        Image.fromarray(photo(shot)).save(FOLDER / f"{name}.jpg", quality=QUALITY)
        print(FOLDER / f"{name}.jpg", flush=True)


if __name__ == "__main__":
    main()
