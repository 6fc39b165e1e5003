"""What is to be sampled: pictures, conditions, clips and runs; what cannot be used is refused by name."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import fracsim.dataset
from fracgen.config.model import Model
from fracgen.config.sample import SampleConfig, Sampler
from fracgen.sampling import generate, job, request, trained_run
from fracsim.dataset import captions
from tests.gen import sampling_run
from tests.gen.sampling_run import (  # noqa: F401
    FRAMES,
    HEIGHT,
    WIDTH,
    WORDS,
    batch_fixture,
    place_fixture,
    sampled,
    single_fixture,
    write_run,
)


def test_the_picture_of_a_clip_is_its_first_frame_in_the_size_of_the_run(batch: SampleConfig, place: Path) -> None:
    """Means of 2 x 2 px; the grips lie where the scene has them, scaled alike."""
    run = trained_run.load(batch.run)
    for one in request.requests(batch, run, ()):
        assert one.clip is not None
        frame = one.clip.read("rgb", 0, 1)[0].astype(np.float64)
        means = frame.reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3))
        assert np.abs(one.read() - means).max() <= 0.5
        assert np.allclose(one.paths, one.condition.paths(FRAMES, WIDTH, HEIGHT), atol=1e-9)  # seen from the front
        assert one.caption == captions.prompt(one.clip.row)


def test_positions_move_with_the_picture_on_its_canvas(single: SampleConfig, place: Path) -> None:
    """96 x 32 on 48 x 32: fitted, it is 48 x 16 px and begins 8 px below the top; cropped, its middle half is left."""
    wide = sampling_run.picture(place / "wide.png", 96, 32)
    given = sampling_run.condition(place / "wide.json", grips=[0.25, 0, 0.75, 1], velocity=[-1, 0.5, 1, 0], fps=25)
    cfg, run = replace(single, image=str(wide), condition=str(given)), trained_run.load(single.run)
    fitted, cropped = (request.of_file(replace(cfg, fit=fit), run) for fit in ("fit", "crop"))
    assert fitted.paths[0].tolist() == [[12, 8], [36, 24]]
    assert cropped.paths[0].tolist() == [[0, 0], [48, 32]]
    assert np.allclose(fitted.paths[-1] - fitted.paths[0], np.array([[-48, 8], [48, 0]]) * 0.04)  # 4 frames at 100 / s
    assert fitted.condition.fps == 100.0


@pytest.mark.parametrize(("stem", "name", "split"), [("tart", "tart", "none"), ("cake", "pictured cake", "none")])
def test_a_picture_is_of_no_split_whatever_its_name(
    stem: str, name: str, split: str, single: SampleConfig, place: Path
) -> None:
    image = sampling_run.picture(place / f"{stem}.png")
    (made,) = sampled(replace(single, image=str(image), maps=[]))
    (row,) = fracsim.dataset.open(made.path.parent).table.to_pylist()
    assert (row["object"], row["split"], row["class"]) == (name, split, "low_stretch")


def test_the_caption_is_that_of_the_condition_or_made_from_it(single: SampleConfig, place: Path) -> None:
    run = trained_run.load(single.run)
    assert request.of_file(single, run).caption == (
        "A tart of a soft material that stretches little is pulled horizontally."
    )
    sampling_run.condition(place / "own.json", caption="A tart tears.", category="high_stretch")
    assert request.of_file(replace(single, condition=str(place / "own.json")), run).caption == "A tart tears."


def test_another_shift_than_that_of_the_training_is_warned_of(single: SampleConfig) -> None:
    with pytest.warns(UserWarning, match=r"sampler\.shift=1 is not that of the training, 5"):
        (made,) = sampled(replace(single, maps=[], sampler=Sampler(solver="euler", steps=2, shift=1.0)))
    assert made.meta["content"]["sampler"]["shift"] == 1.0


def test_a_latent_that_is_not_finite_is_refused(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate, "velocity", lambda network, x, sigma, inputs: x * float("nan"))
    with pytest.raises(ValueError, match=r"sampler\.dtype=float32: the network gives numbers that are not finite"):
        sampled(single)
    assert not list(Path(single.output.folder).glob("*"))


BAD: dict[str, tuple[Callable[[SampleConfig, Path], SampleConfig], str]] = {
    "no run": (lambda c, p: replace(c, run=""), "run= is empty"),
    "a run that is none": (lambda c, p: replace(c, run=str(p / "data")), r"run=.*data has no trained\.safetensors"),
    "maps of stage 1": (lambda c, p: replace(c, run=str(p / "stage1-a"), maps=["damage"]),
                        r"maps=\[damage\]: run=.*stage1-a is of stage 1 and predicts rgb, not damage"),
    "nothing to sample": (lambda c, p: replace(c, image="", condition=""),
                          r"give image=FILE and condition=FILE, or data"),
    "both kinds": (lambda c, p: replace(c, data=str(p / "data")), r"data, image, condition: give image=FILE and"),
    "no condition": (lambda c, p: replace(c, condition=""), r"condition= is empty: .*give condition=FILE"),
    "no image": (lambda c, p: replace(c, image=""), r"image= is empty: .*give image=FILE"),
    "truth of a picture": (lambda c, p: replace(c, scales="truth"), r"scales=truth needs simulated clips"),
    "mask of a data set": (lambda c, p: replace(c, image="", condition="", data=str(p), mask="m.png"),
                           r"mask=m\.png has no effect with data="),
    "cutout of a data set": (lambda c, p: replace(c, image="", condition="", data=str(p), cutout="auto"),
                             r"cutout=auto has no effect with data="),
    "a condition that is none": (lambda c, p: replace(c, condition=str(p / "tart.png")),
                                 r"condition=.*tart\.png cannot be"),
    "an image that is none": (lambda c, p: replace(c, image=str(p / "pull.json")),
                              r"image=.*pull\.json cannot be read"),
    "another VAE": (lambda c, p: replace(c, vae=replace(c.vae, seed=1)),
                    r"vae\.path: run=.*stage3-b was trained with vae=\w+, but the one chosen is \w+"),
    "another encoder": (lambda c, p: replace(c, encoders=replace(WORDS, text="umt5")),
                        r"encoders\.text_path= holds no UMT5"),
    "no clip": (lambda c, p: replace(c, image="", condition="", data=str(p / "data"), split="train", objects=["duck"]),
                r"data=.*data holds no clip of split=train and objects=\[duck\]"),
    "no data set": (lambda c, p: replace(c, image="", condition="", data=str(p / "nowhere")),
                    r"nowhere is not a folder"),
    "other base weights": (lambda c, p: replace(c, base=str(p)), r"model\.path|weights"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_by_name(name: str, single: SampleConfig, place: Path) -> None:
    change, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        job.run(change(single, place))
    assert not list(Path(single.output.folder).glob("*/"))


def test_a_device_that_is_not_there_is_refused(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    with pytest.raises(ValueError, match="device=mps is not there: set device=auto"):
        job.run(replace(single, device="mps"))


def test_embeddings_of_another_width_are_refused(single: SampleConfig, place: Path) -> None:
    cache = {**sampling_run.cache(), "text": "words-64"}
    write_run(place / "stage3-c", cache=cache)
    with pytest.raises(
        ValueError, match=r"encoders\.text: run=.*stage3-c was trained with text=words-64, but .* words-12"
    ):
        job.run(replace(single, run=str(place / "stage3-c")))


def test_a_run_that_does_not_say_how_its_latents_were_made_finds_their_cache(place: Path) -> None:
    folder = place / "latents"
    folder.mkdir()
    (folder / "cache.json").write_text(json.dumps(sampling_run.cache()))
    told = {"data": {"folder": str(folder)}, "loss": {"shift": 3.0}}
    run = trained_run.load(str(write_run(place / "stage3-d", cache={}, config=told)))
    assert (run.size, run.shift) == ((FRAMES, HEIGHT, WIDTH), 3.0)
    (folder / "cache.json").unlink()
    with pytest.raises(
        ValueError, match=r"does not say how its latents were made, and their cache cannot be asked: .*latents"
    ):
        trained_run.load(str(place / "stage3-d"))


def test_the_model_of_a_run_may_lie_elsewhere(place: Path) -> None:
    run = trained_run.load(str(place / "stage3-b"), "/weights/elsewhere")
    assert run.model == replace(sampling_run.MODEL, path="/weights/elsewhere")
    assert isinstance(trained_run.load(str(place / "stage3-b")).model, Model)
