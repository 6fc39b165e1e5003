"""What cases share: a small VAE, a cache of random latents, a finished training on it, a picture, a condition."""

import contextlib
import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from fracgen import data, encoders, vae
from fracgen.config.model import Encoders, Vae
from fracgen.config.train import TrainConfig
from fracgen.data import Batch, synthetic
from fracgen.sample import SAMPLE
from fracgen.sampling import job
from fracgen.train import TRAIN
from fracgen.training import stages
from fracgen.training.runs import Run
from fracsim.records import Array
from fracsim.sample import read
from fracsim.scene.condition import Condition

TEXT, SIZE, FRAMES = 16, 32, 5
TRAINING = (
    "model=tiny", "model.layers=1", "model.heads=2", "model.head_dim=16", "model.ffn_dim=32", f"model.text_dim={TEXT}",
    "trainer=cpu", "trainer.batch=1", "trainer.effective_batch=2", "trainer.val_steps=0", "data.workers=0",
    "logger.kind=none", "logger.videos=0", "stages.stage1.streams=[rgb,flow,strain,stress,damage]",
    "stages.stage1.constitutive=true", "stages.stage1.steps=2", "stages.stage1.warmup=1",
)  # fmt: skip
"""A stage with all streams and losses, of two steps."""
VAE = ("vae.base_dim=4", "vae.dim_mult=[1,1,1,1]", "vae.res_blocks=1")


@dataclass(frozen=True)
class Place:
    """A folder with all of it."""

    folder: Path
    run: Path
    """Folder of the training."""

    @property
    def latents(self) -> Path:
        """Folder of the cache."""
        return self.folder / "latents"

    def batch(self, *numbers: int) -> Batch:
        """Clips of the cache."""
        cache = data.open(self.latents)
        return data.collate([cache[k] for k in numbers])

    def picture(self, folder: Path) -> Path:
        """A picture of a disc on white."""
        y, x = np.mgrid[:SIZE, :SIZE]
        disc = (x - SIZE / 2) ** 2 + (y - SIZE / 2) ** 2 < (SIZE / 3) ** 2
        path = folder / "tart.png"
        Image.fromarray(np.where(disc[..., None], (180, 90, 40), 255).astype(np.uint8)).save(path)
        return path


def prepare(folder: Path) -> Place:
    """Make all of it in a folder; takes seconds."""
    latents(folder / "latents")
    with contextlib.redirect_stdout(io.StringIO()):
        (run,) = train(folder, folder / "latents")
    return Place(folder, run.folder)


def latents(folder: Path, **options: Any) -> Path:
    """A cache of random latents, said to be of the VAE and the encoders here; `options` as `synthetic.write` has."""
    words = Encoders(text="words", image="zeros")
    network = Vae(base_dim=4, dim_mult=[1, 1, 1, 1], res_blocks=1)
    about = {"vae": vae.identity_of(network), "text": encoders.text_identity(words, TEXT), "image": "zeros"}
    return synthetic.write(folder, **{"frames": FRAMES, "size": SIZE, "text_dim": TEXT, "about": about, **options})


def config(folder: Path, cache: Path, *overrides: str) -> TrainConfig:
    """A training on a cache, into a folder."""
    return TRAIN.compose(*TRAINING, f"data.folder={cache}", f"output.folder={folder / 'runs'}", *overrides)


def train(folder: Path, cache: Path, *overrides: str) -> list[Run]:
    """Train, and return the runs."""
    return stages.run(config(folder, cache, *overrides))


def sample(
    place: Place, folder: Path, *overrides: str, picture: Path | None = None, condition: Mapping[str, Any] | None = None
) -> list[Array]:
    """Sample a clip and return its stored colours and maps; `condition` has fields that differ from the default."""
    pull = folder / "pull.json"
    pull.write_text(json.dumps({**asdict(Condition()), **(condition or {})}), encoding="utf-8")
    cfg = SAMPLE.compose(
        f"run={place.run}", f"image={picture or place.picture(folder)}", f"condition={pull}", *VAE, "encoders=tiny",
        "sampler.steps=2", f"output.folder={folder / 'generated'}", "device=cpu", *overrides,
    )  # fmt: skip
    (made,) = job.run(cfg)
    clip = read(made)
    return [clip.rgb, *(clip.maps[name] for name in clip.maps)]
