"""Streams of frames to video files and back, through the ffmpeg that imageio-ffmpeg ships, or PyAV if it is installed.

The processes are run here, not by imageio_ffmpeg.write_frames, which hides the exit status of the encoder: a full disk
would pass for a finished file.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from io import BufferedReader
from pathlib import Path
from types import TracebackType
from typing import Any, cast

import numpy as np
from imageio_ffmpeg import get_ffmpeg_exe

from fracsim.entry.interrupt import APART
from fracsim.records import Array

DECODER = "FRACSIM_DECODER"
"""Environment variable that may be `ffmpeg`: then PyAV is not used."""
FPS = 25
"""Playback rate of every file: slow motion for people, and whole milliseconds in Matroska. Times are in meta.json."""
# FFV1 version 3: intra only, a CRC a slice. One cluster a frame, flushed, so that a killed encoder leaves whole frames.
_FFV1 = ("-c:v", "ffv1", "-level", "3", "-g", "1", "-slices", "4", "-threads", "2",
         "-cluster_time_limit", "1", "-flush_packets", "1")  # fmt: skip
CODECS: dict[str, tuple[str, tuple[str, ...]]] = {
    "rgb": ("rgb24", ("-pix_fmt", "bgr0", "-coder", "rice", *_FFV1)),
    "gray16": ("gray16le", ("-pix_fmt", "gray16le", "-coder", "range_tab", *_FFV1)),
    "strip": ("rgb24", ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "18", "-preset", "veryfast",
                        "-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "bt709",
                        "-vf", "scale=out_color_matrix=bt709", "-movflags", "+faststart")),
}  # fmt: skip
"""Pixel format of a frame in memory, and how the encoder writes it."""
ROOM = 1 << 20
"""Bytes in the pipe to an encoder, the most that Linux grants by default; a picture of 512 x 512 has 3/4 of it."""
_SHAPES: dict[str, tuple[tuple[int, ...], Any]] = {"rgb": ((3,), np.uint8), "gray16": ((), np.dtype("<u2"))}


class Encoder:
    """One video file that takes frames [height, width] or [height, width, 3] one by one."""

    def __init__(self, path: Path, width: int, height: int, codec: str) -> None:
        pixels, options = CODECS[codec]
        self.path = path
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115  # an unread pipe could fill and block
        command = [get_ffmpeg_exe(), "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", pixels,
                   "-s", f"{width}x{height}", "-r", str(FPS), "-i", "-", "-an", *options, str(path)]  # fmt: skip
        # Ctrl-C at the terminal must not end the encoder before its last frame.
        try:
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL,
                                             stderr=self._errors, **APART)  # fmt: skip
        except (FileNotFoundError, PermissionError) as error:
            raise ValueError(f"ffmpeg cannot be started as {command[0]} ({error.strerror}): unset "
                             "IMAGEIO_FFMPEG_EXE, or set it to an ffmpeg that runs.") from None  # fmt: skip
        _widen(self._process.stdin)

    def write(self, frame: Array) -> None:
        """Append a frame, (height, width) or (height, width, 3); raises OSError when the encoder has ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(frame).data.cast("B"))
        except OSError:
            self.close()
            raise OSError(f"the encoder of {self.path.name} ended early") from None

    def close(self) -> None:
        """Finish the file; raises OSError when the encoder failed. Later calls do nothing."""
        if self._errors.closed:
            return
        assert self._process.stdin is not None
        with suppress(OSError):  # it has ended already; the reason follows below
            self._process.stdin.close()
        code = self._process.wait()
        self._errors.seek(0)
        message = self._errors.read().decode(errors="replace").strip().partition("\n")[0].rpartition("] ")[2]
        self._errors.close()
        if code != 0:
            raise OSError(f"the encoder of {self.path.name} ended with status {code}: {message or 'no message'}")

    def __enter__(self) -> "Encoder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _widen(pipe: Any) -> None:
    """Let a pipe hold a frame, where the system can, so that its writer need not wait for the encoder."""
    with suppress(ImportError, AttributeError, OSError):  # no pipe of Linux, or too many wide ones
        import fcntl

        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, ROOM)


def decode(path: Path, width: int, height: int, codec: str, start: int, stop: int) -> Array:
    """Frames start .. stop - 1, or those before the first damaged one, [T, height, width(, 3)].

    uint8 for codec "rgb", uint16 for "gray16". Files are intra-only, so no other frame is decoded. PyAV reads FFV1
    where it is installed, unless the environment says FRACSIM_DECODER=ffmpeg.
    """
    tail, dtype = _SHAPES[codec]
    out = np.empty((stop - start, height, width, *tail), dtype)
    if start >= stop:
        return out
    if os.environ.get(DECODER) != "ffmpeg" and _has_pyav():
        from fracsim.sample import pyav  # here, because PyAV is not always there

        done = pyav.decode(path, out, start, FPS)
        if done is not None:
            return out[:done]
    return out[: _decode(path, out, start, codec)]


@cache
def _has_pyav() -> bool:
    return find_spec("av") is not None


def _decode(path: Path, out: Array, start: int, codec: str) -> int:
    """Fill `out` with frames from `start` on through ffmpeg, and return how many come before the first damaged one."""
    # At a constant rate frame k begins at k / FPS, a whole number of milliseconds.
    options = ("-frames:v", str(len(out)), "-f", "rawvideo", "-pix_fmt", CODECS[codec][0], "-")
    command = _reading(path, start / FPS, *options)
    with (
        tempfile.TemporaryFile() as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors) as process,
    ):
        stream = cast(BufferedReader, process.stdout)
        received = stream.readinto(out.data.cast("B"))
        stream.close()  # ffmpeg must not wait for a reader
        process.wait()
        errors.seek(0)
        return min(int(received // out[0].nbytes), _intact(errors.read()))


def count(path: Path) -> int:
    """Number of frames before the first damaged one; 0 when the file cannot be read."""
    listing = subprocess.run(_reading(path, 0.0, "-f", "framecrc", "-"), capture_output=True)
    frames = sum(not line.startswith(b"#") for line in listing.stdout.splitlines())
    return min(frames, _intact(listing.stderr))


def _reading(path: Path, start: float, *output: str) -> Sequence[str]:
    """The command that decodes `path` from the time `start` [s] and stops at the first damage."""
    # Threads share the slices of a frame: threads that take a frame each would also decode frames after the last one.
    strict = ("-xerror", "-err_detect", "explode", "-thread_type", "slice")
    seek = ("-ss", f"{start:.3f}") if start else ()
    return (get_ffmpeg_exe(), "-v", "error", *strict, *seek, "-i", str(path), "-map", "0:v:0", *output)


def _intact(errors: bytes) -> int:
    """Frames before the first one that ffmpeg replaced by a guess, because a checksum of FFV1 did not match."""
    times = re.findall(rb"CRC mismatch \w+!at ([0-9.]+) seconds", errors)  # counted from the first frame asked for
    return min((round(float(t) * FPS) for t in times), default=sys.maxsize)
