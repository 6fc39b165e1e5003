"""What a writer must know of a sample before its first frame, for any producer."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from fracsim import registry
from fracsim.camera import view_of
from fracsim.maps import load as load_map
from fracsim.sample.identity import FRACSIM, sample_id, scene_content
from fracsim.sample.origin import sources
from fracsim.sample.provenance import PACKAGES
from fracsim.sample.schema import SCENE
from fracsim.scene.vocab import Scene
from fracsim.version import __version__

PICTURES = ("rgb", "alpha")
"""Names that no map may have."""


@dataclass(frozen=True)
class MapInfo:
    """What a recorded map holds; its pixels have the quantity times the coverage, if that is recorded."""

    label: str
    """Its name for people."""
    unit: str
    """Its unit, "1" for a plain number."""
    channels: int
    """1 for a scalar, 2 for a vector (right, up) in the image plane."""
    scale: float | None = None
    """Value shown as 1; None = the largest of the clip, without outliers (`fracsim.sample.quantise`)."""


@dataclass(frozen=True, kw_only=True)
class Header:
    """The identity of a sample, its size, what it records and its origin; raises ValueError for a map named rgb."""

    producer: str
    """Program that makes the sample, as fracsim."""
    version: str
    """Version of the producer."""
    content: Mapping[str, Any]
    """What names the sample: the id is a hash of `producer` and this."""
    document: Mapping[str, Any]
    """What makes the sample again, written as YAML: texts, numbers, lists and mappings."""
    document_file: str = "document.yaml"
    """Name of the file of `document`."""
    width: int
    """Picture width [px]."""
    height: int
    """Picture height [px]."""
    frames: int
    fps: float
    """Frames a second of simulated time [1/s]; frame k shows t = k / fps."""
    rgb: bool = True
    """Whether colour is recorded."""
    alpha: bool = False
    """Whether coverage is recorded; without it every pixel counts as covered."""
    maps: Mapping[str, MapInfo] = field(default_factory=dict)
    tracks: int = 0
    """Largest number of tracked particles."""
    strip: bool = True
    """Whether to write strip.mp4."""
    report: bool = False
    """Whether to write report.png, when there is a history."""
    thresholds: tuple[float, float] | None = None
    """Stretches of onset and complete damage that report.png marks."""
    about: Mapping[str, Any] = field(default_factory=dict)
    """More entries of meta.json, as view or backend."""
    packages: Sequence[str] = ()
    """Distributions whose versions belong to the provenance."""

    def __post_init__(self) -> None:
        for name in set(PICTURES) & set(self.maps):
            raise ValueError(
                f"maps={sorted(self.maps)}: {name} is no name for a map, since a picture has it: rename it."
            )

    @property
    def id(self) -> str:
        """The id of the sample."""
        return sample_id(self.producer, self.content)

    @property
    def pictures(self) -> bool:
        """Whether anything is shown."""
        return bool(self.rgb or self.maps)


def header_of(scene: Scene) -> Header:
    """The header of the sample of a scene.

    Raises ValueError for an unknown map or camera, and when the file of the object cannot be read.
    """
    capture, view = scene.capture, view_of(scene)
    return Header(
        producer=FRACSIM,
        version=__version__,
        content=scene_content(scene),
        document=asdict(scene),
        document_file=SCENE,
        width=view.width,
        height=view.height,
        frames=capture.frames,
        fps=capture.fps,
        rgb=capture.rgb,
        alpha=capture.renders,
        maps=map_infos(capture.maps),
        tracks=capture.tracks,
        strip=capture.strip,
        report=capture.report,
        thresholds=(scene.fracture.onset, scene.fracture.crit),
        about={"view": view, "backend": scene.backend, "sources": sources(scene)},
        packages=PACKAGES,
    )


def map_infos(names: Sequence[str]) -> dict[str, MapInfo]:
    """Label, unit, channels and scale of maps by name, without folder and ending; raises ValueError for a bad one."""
    modules = {registry.label(name): load_map(name) for name in names}
    if len(modules) < len(names):
        raise ValueError(f"capture.maps={list(names)} has two maps of one name: rename a file.")
    return {name: MapInfo(m.LABEL, m.UNIT, m.CHANNELS, m.SCALE) for name, m in modules.items()}
