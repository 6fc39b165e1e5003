"""python -m fracgen.encode: what goes into a latent cache."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

import fracgen.data
import fracsim.dataset
from fracgen import conditioning, encoders
from fracgen.config.model import Encoders
from fracgen.data import pictures
from fracsim import codec
from fracsim.sample import read
from tests.gen.clips import FoldedVae, random_clips
from tests.gen.encodings import CPU, cfg, clips_fixture, near, run, simulated_fixture  # noqa: F401


def test_a_clip_is_encoded_stream_by_stream(simulated: Path, tmp_path: Path) -> None:
    """By another road than the program's: whole arrays, and the 99.5th percentile of what is not background."""
    run(cfg(simulated, tmp_path, width=64, height=64, frames=17))
    cache = fracgen.data.open(tmp_path)
    assert {row["object"] for row in cache.rows} == {"croissant", "duck", "star"}
    for k, row in enumerate(cache.rows):
        sample, clip = read(simulated / row["id"]), cache[k]
        assert list(clip.latents) == ["rgb", "flow", "strain", "stress", "damage"]
        assert near(clip.latents["rgb"], sample.rgb.astype(np.float32) / np.float32(255))
        for name, values in sample.maps.items():
            size = np.linalg.norm(values, axis=-1)
            scale = 1.0 if name == "damage" else float(np.percentile(size[size > 0], 99.5))
            assert row["scales"][name] == pytest.approx(scale, rel=1e-6)  # the mean of two floats
            assert near(clip.latents[name], codec.encode(values, row["scales"][name]))


def test_the_reference_is_the_latent_of_the_first_frame_alone(simulated: Path, tmp_path: Path) -> None:
    run(cfg(simulated, tmp_path, width=64, height=64, frames=17, streams=["rgb"]))
    cache = fracgen.data.open(tmp_path)
    first = read(simulated / cache.rows[0]["id"]).rgb[:1].astype(np.float32) / np.float32(255)
    assert near(cache[0].reference[:, None], first)


def test_the_loading_is_that_of_the_scene_and_is_shared_where_it_is_equal(simulated: Path, tmp_path: Path) -> None:
    """Two of the four clips differ in stiffness only: three forces. Blobs stand where the camera sees the grips."""
    _, encoded = run(cfg(simulated, tmp_path, width=64, height=64, frames=17, streams=["rgb", "damage"]))
    assert encoded == 4 * 2 + 3
    cache = fracgen.data.open(tmp_path)
    assert Counter(Counter(row["force"] for row in cache.rows).values()) == {1: 2, 2: 1}
    for k, row in enumerate(cache.rows):
        scene = read(simulated / row["id"]).scene
        condition = conditioning.of_scene(scene)
        assert near(cache[k].force, conditioning.blobs(conditioning.scene_paths(scene, 17), 64, 64))
        assert torch.equal(cache[k].scalars, torch.from_numpy(conditioning.scalars(condition)))
        assert (row["E"], row["onset"], row["axis_deg"]) == (condition.E, condition.onset, scene.loading.axis_deg)


def test_a_caption_is_embedded_once(simulated: Path, tmp_path: Path) -> None:
    run(cfg(simulated, tmp_path, width=64, height=64, frames=17, streams=["rgb"]))
    cache = fracgen.data.open(tmp_path)
    captions = [row["caption"] for row in cache.rows]
    words = encoders.text(Encoders(text="words"), 8)
    for k, caption in enumerate(captions):
        assert torch.equal(cache[k].text, encoders.pad(words.encode([caption]))[0].bfloat16())
    assert len({row["text"] for row in cache.rows}) == len(set(captions)) == 3


def test_a_caption_does_not_tell_the_outcome(simulated: Path, tmp_path: Path) -> None:
    """A user of the model does not know it; the table of the data set does."""
    run(cfg(simulated, tmp_path, width=64, height=64, frames=17, streams=["rgb"]))
    told = {clip.row["id"]: clip.row["caption"] for clip in fracsim.dataset.open(simulated, suspect=True)}
    for row in fracgen.data.open(tmp_path).rows:
        assert not {"breaks", "holds"} & set(row["caption"].strip(".").split())
        assert told[row["id"]].startswith(row["caption"].rstrip("."))


def test_a_picture_is_embedded_once(simulated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The ducks begin alike, so that three pictures are embedded."""
    seen = []

    class Image:
        def encode(self, rgb: Tensor) -> Tensor:
            seen.append(rgb)
            return torch.full((1, 257, 4), float(rgb.float().mean()))

    monkeypatch.setattr(encoders, "image", lambda *_: Image())
    run(cfg(simulated, tmp_path, width=64, height=64, frames=17, streams=["rgb"]))
    cache = fracgen.data.open(tmp_path)
    assert len(seen) == len({row["image"] for row in cache.rows}) == 3
    first = torch.from_numpy(read(simulated / cache.rows[3]["id"]).rgb[0])
    assert any(torch.equal(rgb[0], first) for rgb in seen)
    assert torch.equal(cache[3].image, torch.full((257, 4), float(first.float().mean())).bfloat16())


def test_pictures_are_averaged_over_squares_of_pixels(tmp_path: Path) -> None:
    """Also maps, which hold a quantity times its coverage: their means are so again, and zero stays background."""
    data = random_clips(tmp_path / "data", ["duck"], speeds=[1.0], size=(64, 96))
    run(cfg(data, tmp_path / "latents", streams=["rgb", "flow"]))
    cache = fracgen.data.open(tmp_path / "latents")
    sample = read(tmp_path / "data" / cache.rows[0]["id"])

    def halved(video: Any) -> Any:
        return sum(video[:5, i::2, j::2].astype(np.float64) for i in range(2) for j in range(2)) / 4

    flow = halved(sample.maps["flow"]).astype(np.float32)
    # One bfloat16 step of latents of size 2: the two roads add up in another order.
    assert torch.allclose(cache[0].latents["rgb"].float(), _folded(halved(sample.rgb) / 255), atol=2**-7)
    assert torch.allclose(
        cache[0].latents["flow"].float(), _folded(codec.encode(flow, codec.scale(flow, 99.5))), atol=2**-7
    )
    scene = sample.scene
    half = conditioning.scene_paths(scene, 5) / 2
    assert near(cache[0].force, conditioning.blobs(half, 32, 48))


def _folded(video: Any) -> Tensor:
    return FoldedVae().encode(torch.from_numpy(np.asarray(video, np.float32)).permute(3, 0, 1, 2)[None])[0]


@pytest.mark.parametrize(
    ("how", "numbers"), [("head", [0, 1, 2, 3, 4]), ("tail", [5, 6, 7, 8, 9]), ("linspace", [0, 2, 4, 7, 9])]
)
def test_frames_are_selected(how: str, numbers: list[int]) -> None:
    """Evenly spread: round(9 k / 4) with 4.5 to the even 4."""
    assert pictures.select(10, 5, how).tolist() == numbers


def test_pictures_and_blobs_show_the_same_frames(clips: Path, tmp_path: Path) -> None:
    run(cfg(clips, tmp_path, frame_select="tail", streams=["rgb"]))
    cache = fracgen.data.open(tmp_path)
    sample = read(clips / cache.rows[0]["id"])
    assert near(cache[0].latents["rgb"], sample.rgb[1:6].astype(np.float32) / np.float32(255))
    assert near(cache[0].force, conditioning.blobs(conditioning.scene_paths(sample.scene, 6)[1:], 32, 48))
