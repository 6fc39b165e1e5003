"""PyAV and ffmpeg read the same bits and stop at the same damage."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fracsim import Scene, sample
from fracsim.sample import pyav, video
from fracsim.sample.quantise import LEVELS, dequantise

from .recording import FRAMES, HEIGHT, WIDTH, Clip

Record = Callable[[Scene], Path]
DECODERS = ("av", "ffmpeg")


@pytest.mark.parametrize("decoder", DECODERS)
@pytest.mark.parametrize(("start", "stop"), [(0, FRAMES), (1, 3), (FRAMES - 1, FRAMES)])
def test_the_frames_that_were_written(scene: Scene, record: Record, clip: Clip, monkeypatch: pytest.MonkeyPatch,
                                      decoder: str, start: int, stop: int) -> None:  # fmt: skip
    monkeypatch.setenv(video.DECODER, decoder)
    read = sample.read(record(scene))
    assert (read.read("rgb", start, stop) == clip.rgb[start:stop]).all()
    assert (read.stored("alpha", start, stop) == np.rint(clip.alpha[start:stop] * LEVELS)).all()
    assert read.stored("flow", start, stop).shape == (stop - start, 2, HEIGHT, WIDTH)
    assert read.read("flow", start, stop) == pytest.approx(clip.maps["flow"][start:stop], abs=2.5 / LEVELS)


@pytest.mark.parametrize("name", ["rgb.mkv", "alpha.mkv", "maps/flow.mkv"])
@pytest.mark.parametrize("part", [0.3, 0.5, 0.9])
@pytest.mark.parametrize("damage", ["zeros", "cut"])
def test_both_stop_at_the_same_damage(scene: Scene, record: Record, monkeypatch: pytest.MonkeyPatch, name: str,
                                      part: float, damage: str) -> None:  # fmt: skip
    path = record(scene) / name
    content = bytearray(path.read_bytes())
    at = int(part * len(content))
    content[at:] = content[at:][:0] if damage == "cut" else bytes(50) + content[at + 50 :]
    path.write_bytes(content)
    height, codec = (2 * HEIGHT if "flow" in name else HEIGHT), "rgb" if name == "rgb.mkv" else "gray16"
    whole = []
    for decoder in DECODERS:
        monkeypatch.setenv(video.DECODER, decoder)
        whole.append([video.decode(path, WIDTH, height, codec, start, FRAMES) for start in (0, 2)])
    for by_pyav, by_ffmpeg in zip(*whole, strict=True):
        assert by_pyav.shape == by_ffmpeg.shape
        assert (by_pyav == by_ffmpeg).all()
    assert len(whole[0][0]) < FRAMES


def test_what_is_no_video(tmp_path: Path) -> None:
    (tmp_path / "a.mkv").write_bytes(bytes(1000))
    assert len(video.decode(tmp_path / "a.mkv", 8, 8, "rgb", 0, 3)) == 0
    assert not pyav.whole(b"")
    assert not pyav.whole(b"\1\2\3")


def test_values_are_the_product_of_whole_steps() -> None:
    """As in whole numbers: (code - code of zero) x step, rounded once."""
    codes = np.arange(LEVELS + 1, dtype=np.uint16)
    for lo, hi in ((0.0, 3e4), (-0.7, 1.9), (-2e-9, 1e-12)):
        step = (hi - lo) / LEVELS
        exact = (codes.astype(np.int64) - round(-lo / step)) * np.float64(np.float32(step))  # 17 + 24 bits fit
        assert (dequantise(codes, lo, hi) == exact.astype(np.float32)).all()
