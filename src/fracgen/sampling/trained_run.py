"""The training that a sample comes from: its sizes, and whether VAE and encoders are those that it was trained with."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from fracgen import encoders, layout
from fracgen.config.encode import EncodeConfig
from fracgen.config.model import Encoders, Model
from fracgen.config.sample import ALL
from fracgen.data import index
from fracgen.model import trained
from fracsim.sample.identity import digest


@dataclass(frozen=True)
class TrainedRun:
    """What a run says about itself, and what its latents were made with."""

    path: str
    """As it was given."""
    about: Mapping[str, Any]
    """The metadata of its weights."""
    cache: Mapping[str, Any]
    """The entries of cache.json of its latents."""
    weights: str
    """12 hex digits of the sha256 of its weights."""
    model: Model

    @property
    def streams(self) -> tuple[str, ...]:
        """What it predicts."""
        return layout.ordered(self.about["streams"])

    @property
    def shift(self) -> float:
        """Shift of its noise levels."""
        return float(self.about["config"]["loss"]["shift"])

    @property
    def size(self) -> tuple[int, int, int]:
        """Frames, height and width of its clips [px]."""
        return self.cache["frames"], self.cache["height"], self.cache["width"]

    def maps(self, asked: Sequence[str]) -> tuple[str, ...]:
        """The maps that `asked` names, in the order of the layout; raises ValueError for one that it lacks."""
        mine = self.streams[1:]
        missing = [name for name in asked if name not in (*mine, ALL)]
        if missing:
            raise ValueError(f"maps=[{','.join(asked)}]: run={self.path} is of stage {self.about['stage']} and "
                             f"predicts {', '.join(self.streams)}, not {', '.join(missing)}: ask for "
                             f"maps=[{','.join(mine)}], or give the run of a later stage.")  # fmt: skip
        return tuple(name for name in mine if name in asked or ALL in asked)

    def encoding(self, data: str, streams: Sequence[str]) -> EncodeConfig:
        """How clips of a data set become the videos that it was trained on."""
        frames, height, width = self.size
        return EncodeConfig(data=data, streams=list(streams), width=width, height=height, frames=frames,
                            frame_select=self.cache["frame_select"], fps=self.cache["fps"],
                            percentile=self.cache["normalisation"]["percentile"])  # fmt: skip

    def check_vae(self, identity: str) -> None:
        """Raise ValueError unless the VAE is that of its latents."""
        self._check("vae", "vae.path", identity)

    def check_encoders(self, cfg: Encoders) -> None:
        """Raise ValueError unless the encoders are those of its embeddings; loads no network."""
        self._check("text", "encoders.text", encoders.text_identity(cfg, self.cache["text_dim"]))
        if self.model.image_dim:
            self._check("image", "encoders.image", encoders.image_identity(cfg))

    def _check(self, name: str, field: str, identity: str) -> None:
        if identity != self.cache[name]:
            raise ValueError(f"{field}: run={self.path} was trained with {name}={self.cache[name]}, but the one chosen "
                             f"is {identity}: choose the same weights and sizes.")  # fmt: skip


def load(path: str, base: str = "") -> TrainedRun:
    """The run in a folder, whose base weights may lie in `base`; raises ValueError when it cannot be sampled from."""
    if not path:
        raise ValueError("run= is empty: give the folder of a training, as run=runs/stage3-0123456789ab.")
    _, about = trained.read(path)
    model = trained.model_of(about)
    return TrainedRun(
        path=path,
        about=about,
        cache=_cache(about, path),
        weights=digest(trained.find(path))[:12],
        model=replace(model, path=base) if base else model,
    )


def _cache(about: Mapping[str, Any], path: str) -> Mapping[str, Any]:
    """How the latents of a run were made: as the run says or, if it does not, as the cache that it names says."""
    if about.get("cache"):
        stored: Mapping[str, Any] = about["cache"]
        return stored
    folder = about["config"]["data"]["folder"]
    try:
        return index.load(Path(folder).expanduser()).about
    except ValueError as error:
        raise ValueError(f"run={path} does not say how its latents were made, and their cache cannot be asked: {error} "
                         "Start this command in the folder of the training.") from None  # fmt: skip
