"""python -m fracsim.lab.gallery: the pictures of README, made from our own samples."""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from fracsim import sample
from fracsim.records import Array
from fracsim.run import pipeline
from fracsim.scene.program import compose

IMG = Path("docs/img")
OBJECTS = ("croissant", "cake", "muffin", "bread", "bread_roll", "duck", "bear", "ring", "star", "whale")
SHOTS = {
    "strip_early": ("asset=duck", "fracture=rubber", "loading.axis_deg=15"),
    "strip_late": ("asset=duck", "fracture=rubber_late", "loading.axis_deg=15"),
}
"""The same pull on the same object, with the earlier and the later thresholds of the paper."""
PHOTO = ("asset=image", "asset.path=docs/photos/bear.jpg", "condition=docs/photos/bear.json", "quality=preview",
         "camera.background=photo", "camera.width=320", "camera.height=320", "capture.frames=50",
         "output.folder=outputs/gallery")  # fmt: skip
"""A photo, torn in front of its ground."""
COMMON = ("camera.half_width=0.75", "capture.frames=50", "output.folder=outputs/gallery")


def film(*overrides: str) -> Path:
    """The sample of a scene, made unless it is there."""
    return pipeline.run(compose(*overrides, *COMMON)).sample().path


def panels(path: Path) -> list[Array]:
    """The pictures of strip.mp4, uint8 (H, W, 3)."""
    import imageio.v3 as iio

    return list(iio.imiter(path / "strip.mp4"))


def animate(rows: list[list[Array]], path: Path, width: int = 1000, step: int = 2) -> None:
    """Save an animation of strips, uint8 (H, W, 3) each, one above the other."""
    frames = []
    for pictures in list(zip(*rows, strict=True))[::step]:
        image = Image.fromarray(np.concatenate(pictures, axis=0))
        frames.append(image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS))
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=80, loop=0, quality=70, method=6)


def sheet(paths: list[Path], path: Path, columns: int = 5) -> None:
    """Each object whole and torn, side by side."""
    tiles = []
    for folder in paths:
        clip = sample.read(folder)
        torn = min(len(clip.rgb) - 1, (clip.meta["report"]["break_frame"] or len(clip.rgb)) + 8)
        middle = slice(clip.rgb.shape[1] // 4, clip.rgb.shape[1] * 3 // 4)  # above and below is white
        tiles.append(np.concatenate([clip.rgb[0, middle], clip.rgb[torn, middle]], axis=1))
    rows = [np.concatenate(tiles[i : i + columns], axis=1) for i in range(0, len(tiles), columns)]
    image = Image.fromarray(np.concatenate(rows, axis=0))
    image.resize((image.width // 2, image.height // 2), Image.Resampling.LANCZOS).save(path, optimize=True)


def main() -> None:
    """Make docs/img/strip.webp, objects.png and photo.webp."""
    if not Path("pyproject.toml").exists():
        sys.exit("error: run this at the top of a checkout, where docs/img is.")
    IMG.mkdir(parents=True, exist_ok=True)
    animate([panels(film(*shot)) for shot in SHOTS.values()], IMG / "strip.webp")
    zoom = ("camera.width=256", "camera.height=256", "loading.speed=0.8", "solver.cells=100", "capture.maps=[damage]")
    animate([panels(pipeline.run(compose(*PHOTO)).sample().path)], IMG / "photo.webp")
    sheet([film(f"asset={name}", *zoom) for name in OBJECTS], IMG / "objects.png")


if __name__ == "__main__":
    main()
