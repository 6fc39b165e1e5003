"""Some frames of a sample are those of the whole, bit for bit."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene, sample
from fracsim.sample.video import Encoder, decode

from .recording import FRAMES

T, WIDTH, HEIGHT = 27, 32, 16
"""Longer than a second of playback, 25 frames."""
BLOCK = b"\x1f\x43\xb6\x75"
"""The first bytes of a Matroska cluster; each holds one frame."""
Record = Callable[[Scene], Path]


@pytest.fixture(scope="module", params=["rgb", "gray16"])
def video(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, np.ndarray]:
    """A video of noise: its file, codec and frames."""
    rng, codec = np.random.default_rng(1), request.param
    if codec == "rgb":
        frames = rng.integers(0, 256, (T, HEIGHT, WIDTH, 3), np.uint8)
    else:
        frames = rng.integers(0, 65536, (T, HEIGHT, WIDTH), np.uint16)
    path = tmp_path_factory.mktemp("video") / f"{codec}.mkv"
    with Encoder(path, WIDTH, HEIGHT, codec) as encoder:
        for frame in frames:
            encoder.write(frame)
    return path, codec, frames


@pytest.mark.parametrize("start", range(T))
def test_every_start_is_exact(video: tuple[Path, str, np.ndarray], start: int) -> None:
    path, codec, frames = video
    for stop in {start + 1, min(start + 5, T), T}:
        assert np.array_equal(decode(path, WIDTH, HEIGHT, codec, start, stop), frames[start:stop])


def test_no_frames_are_an_empty_array(video: tuple[Path, str, np.ndarray]) -> None:
    assert decode(video[0], WIDTH, HEIGHT, video[1], 3, 3).shape[:3] == (0, HEIGHT, WIDTH)


@pytest.mark.parametrize("damaged", [0, 9, T - 1])
def test_damage_counts_within_the_range_only(video: tuple[Path, str, np.ndarray], tmp_path: Path, damaged: int) -> None:
    path, codec, frames = video
    content = bytearray(path.read_bytes())
    blocks = [m.start() for m in re.finditer(re.escape(BLOCK), content)] + [len(content)]
    assert len(blocks) == T + 1
    middle = (blocks[damaged] + blocks[damaged + 1]) // 2
    content[middle : middle + 50] = bytes(50)
    (tmp_path / "damaged.mkv").write_bytes(content)
    for start, stop in ((0, 5), (7, 9), (8, 12), (9, 10), (10, 14), (T - 3, T)):
        read = decode(tmp_path / "damaged.mkv", WIDTH, HEIGHT, codec, start, stop)
        intact = damaged - start if start <= damaged < stop else stop - start
        assert np.array_equal(read, frames[start : start + intact])


@pytest.mark.parametrize("what", ["rgb", "alpha", "flow", "stress"])
def test_a_range_of_a_sample_is_part_of_the_whole(scene: Scene, record: Record, what: str) -> None:
    clip = sample.read(record(scene))
    whole = clip.maps[what] if what in clip.maps else getattr(clip, what)
    for start in range(FRAMES):
        for stop in range(start + 1, FRAMES + 1):
            assert np.array_equal(clip.read(what, start, stop), whole[start:stop])
    assert np.array_equal(clip.read(what), whole)


@pytest.mark.parametrize(("start", "stop"), [(-1, 2), (0, FRAMES + 1), (3, 3), (4, 2), (FRAMES, FRAMES + 1)])
def test_a_range_outside_is_refused(scene: Scene, record: Record, start: int, stop: int) -> None:
    clip = sample.read(record(scene))
    with pytest.raises(ValueError, match=rf"frames {start} to {stop} of flow cannot be read: .* has frames 0 to 5"):
        clip.read("flow", start, stop)


def test_what_was_not_recorded_is_refused(scene: Scene, record: Record) -> None:
    with pytest.raises(ValueError, match=r"heat was not recorded in .*: read one of rgb, alpha, flow, strain"):
        sample.read(record(scene)).read("heat", 0, 1)


def test_damage_in_a_sample_is_found_where_it_is_read(scene: Scene, record: Record) -> None:
    path = record(scene)
    content = bytearray((path / "rgb.mkv").read_bytes())
    last = content.rindex(BLOCK)
    content[last + 200 : last + 250] = bytes(50)
    (path / "rgb.mkv").write_bytes(content)
    clip = sample.read(path)
    assert len(clip.read("rgb", 0, FRAMES - 1)) == FRAMES - 1
    with pytest.raises(ValueError, match=r"rgb\.mkv is damaged: 1 of 2 frames can be decoded"):
        clip.read("rgb", FRAMES - 2, FRAMES)


def test_a_sample_is_shown_in_a_few_lines(scene: Scene, record: Record) -> None:
    shown = repr(sample.read(record(scene)))
    assert len(shown.splitlines()) == 3
    for part in (sample.scene_id(scene), "fracsim", "complete", "5 frames", "64 x 48", "rgb, alpha, flow [m/s]"):
        assert part in shown
