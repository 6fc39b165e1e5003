"""A tiny sample to record, and how to record it."""

from dataclasses import dataclass, replace
from pathlib import Path

from fracsim import Camera, Capture, Output, Scene
from fracsim.records import Array
from fracsim.sample import Writer, header_of

WIDTH, HEIGHT, FRAMES, TRACKS = 64, 48, 5, 7
HISTORY = {
    "t": [k / 100 for k in range(FRAMES)],
    "nominal_stretch": [1.0, 1.1, 1.2, 1.3, 1.4],
    "load": [0.0, 2.0, 3.0, 1.0, 0.0],
    "stretch_max": [1.0, 1.4, 2.0, 2.3, 2.3],
    "damaged": [0.0, 0.0, 0.1, 0.2, 0.2],
    "failed": [0.0, 0.0, 0.0, 0.1, 0.1],
    "dt_t": [0.0, 0.02, 0.04],
    "dt": [2e-4, 1.5e-4, 1e-4],
}


@dataclass
class Clip:
    """T frames of everything a writer takes."""

    rgb: Array
    alpha: Array
    maps: dict[str, Array]
    xy: Array
    visible: Array
    particles: Array


def tiny(folder: Path, **capture: object) -> Scene:
    chosen = replace(Capture(frames=FRAMES, tracks=TRACKS, report=False, strip=False), **capture)
    return Scene(capture=chosen, camera=Camera(width=WIDTH, height=HEIGHT), output=Output(folder=str(folder)))


def open_writer(scene: Scene) -> Writer:
    return Writer(header_of(scene), scene.output)


def add(writer: Writer, clip: Clip, scene: Scene, frames: int = FRAMES) -> None:
    for k in range(frames):
        rgb = clip.rgb[k] if scene.capture.rgb else None
        alpha = clip.alpha[k] if scene.capture.renders else None
        maps = {name: clip.maps[name][k] for name in scene.capture.maps}
        writer.add(k, rgb, alpha, maps, (clip.xy[k], clip.visible[k]))
