"""A run of training whose weights are random, a picture, a condition and clips of random pictures, for sampling."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from fracgen import conditioning, encoders, model, vae
from fracgen.config.conditioning import Conditioning
from fracgen.config.model import Encoders, Lora, Model, Vae
from fracgen.config.sample import Generated, SampleConfig, Sampler
from fracgen.config.train import TrainConfig
from fracgen.model import adapter, trained
from fracgen.sampling import job
from fracsim import Camera, Capture, Scene
from fracsim.sample import Sample, Writer, header_of, read
from fracsim.scene.condition import Condition
from fracsim.scene.vocab import Asset, Loading, Output

WIDTH, HEIGHT, FRAMES, TEXT = 48, 32, 5, 12
MODEL = Model(layers=2, heads=2, head_dim=16, ffn_dim=48, text_dim=TEXT, image_dim=0, train="lora",
              lora=Lora(rank=2, alpha=2.0))  # fmt: skip
VAE = Vae(base_dim=4, dim_mult=[1, 1, 1, 1], res_blocks=1)
WORDS = Encoders(text="words", image="zeros")
STREAMS = ("rgb", "flow", "strain", "stress", "damage")


def cache() -> dict[str, Any]:
    """What cache.json of the run's latents says."""
    return {
        "version": 1, "vae": vae.load(VAE).identity, "vae_dtype": "float32", "width": WIDTH, "height": HEIGHT,
        "frames": FRAMES, "frame_select": "head", "fps": 100.0, "streams": list(STREAMS),
        "text": encoders.text_identity(WORDS, TEXT), "text_dim": TEXT, "image": encoders.image_identity(WORDS),
        "dtype": "bfloat16", "normalisation": {"version": 1, "percentile": 99.5},
    }  # fmt: skip


def write_run(folder: Path, streams: Sequence[str] = STREAMS, stage: int = 3, train: str = "lora",
              **changes: Any) -> Path:  # fmt: skip
    """A folder of a run with random weights, which do change the network."""
    folder.mkdir(parents=True)
    cfg = replace(MODEL, train=train)
    network = model.build(cfg, streams)
    adapter.prepare(network, cfg)
    generator = torch.Generator().manual_seed(5)
    tensors = {name: 0.1 * torch.randn(value.shape, generator=generator)
               for name, value in trained.state(network).items()}  # fmt: skip
    about = {"stage": stage, "streams": list(streams), "model": asdict(cfg), "base": model.base_identity(cfg),
             "scalars": list(conditioning.SCALARS), "conditioning": asdict(Conditioning()),
             "config": asdict(TrainConfig()), "cache": cache(), **changes}  # fmt: skip
    trained.save(folder / trained.FILE, {f"transformer.{name}": value for name, value in tensors.items()}, about)
    return folder


def picture(path: Path, width: int = WIDTH, height: int = HEIGHT) -> Path:
    """A picture of a disc on white."""
    y, x = np.mgrid[:height, :width]
    disc = (x - width / 2) ** 2 + (y - height / 2) ** 2 < (height / 3) ** 2
    Image.fromarray(np.where(disc[..., None], (180, 90, 40), 255).astype(np.uint8)).save(path)
    return path


def condition(path: Path, **changes: Any) -> Path:
    """A condition file."""
    path.write_text(json.dumps({**asdict(Condition()), **changes}))
    return path


def config(run: Path, folder: Path, **changes: Any) -> SampleConfig:
    """The configuration of a sampling into `folder`."""
    return SampleConfig(**{
        "run": str(run), "sampler": Sampler(solver="euler", steps=2), "vae": VAE, "encoders": WORDS,
        "output": Generated(folder=str(folder)), **changes,
    })  # fmt: skip


def clips(folder: Path, objects: Sequence[str] = ("bread", "star", "cake"), factor: int = 2) -> Path:
    """A data set of clips with random pictures, `factor` times as large as those of the run."""
    for k, name in enumerate(objects):
        scene = Scene(capture=Capture(frames=FRAMES + 2, tracks=0, report=False, strip=False),
                      camera=Camera(width=factor * WIDTH, height=factor * HEIGHT),
                      asset=replace(Asset(), name=name), loading=Loading(speed=0.5 + k, axis_deg=30.0))  # fmt: skip
        rng = np.random.default_rng(k)
        shape = (factor * HEIGHT, factor * WIDTH)
        with Writer(header_of(scene), Output(folder=str(folder))) as writer:
            for index in range(FRAMES + 2):
                maps = {"flow": rng.normal(size=(*shape, 2)).astype(np.float32),
                        **{m: rng.random((*shape, 1)).astype(np.float32) for m in ("strain", "damage")},
                        "stress": 5e3 * rng.random((*shape, 1)).astype(np.float32)}  # fmt: skip
                rgb = rng.integers(0, 256, (*shape, 3), dtype=np.uint8)
                writer.add(index, rgb, np.ones(shape, np.float32), maps)
            writer.finish(report={"break_frame": 3, "torn_frame": None, "particles": 9, "substeps": 9, "clamped": 0,
                                  "energy": {"grip_work": 1.0, "gravity_work": 0.0, "unaccounted": 0.0}})  # fmt: skip
    return folder


@pytest.fixture(scope="module", name="place")
def place_fixture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with runs of stages 1 and 3, a picture, a condition, and a data set."""
    folder = tmp_path_factory.mktemp("place")
    write_run(folder / "stage1-a", streams=("rgb",), stage=1)
    write_run(folder / "stage3-b")
    picture(folder / "tart.png")
    condition(folder / "pull.json")
    clips(folder / "data")
    return folder


@pytest.fixture(name="single")
def single_fixture(place: Path, tmp_path: Path) -> SampleConfig:
    """A picture and a condition, into a folder of its own."""
    return config(place / "stage3-b", tmp_path, image=str(place / "tart.png"), condition=str(place / "pull.json"))


@pytest.fixture(name="batch")
def batch_fixture(place: Path, tmp_path: Path) -> SampleConfig:
    """The two clips of the test split, into a folder of its own."""
    return config(place / "stage3-b", tmp_path, data=str(place / "data"))


def sampled(cfg: SampleConfig) -> list[Sample]:
    return [read(folder) for folder in job.run(cfg)]
