"""Decodes the video files of a sample through PyAV, which spares a process a file; bit for bit as ffmpeg does.

libavcodec hides a damaged slice behind the last frame, so the checksums of FFV1 are compared here.
"""

import os
import zlib
from pathlib import Path

import av
import numpy as np

from fracsim.records import Array

_TRAILER = 8
"""Bytes behind each slice of FFV1 version 3: its size (3), an error status (1), a checksum (4)."""
_MIRROR = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in reverse: zlib takes the lowest bit first, FFV1 the highest."""


SLICES = 4
"""Parts of a picture that the encoder made, each of which a thread can decode."""


def decode(path: Path, out: Array, start: int, fps: int) -> int | None:
    """Fill `out`, [T, H, W, 3] uint8 or [T, H, W] uint16, with frames from `start` on, and return how many are whole.

    The frames behind the first damaged one are not decoded. None for a file of another codec than FFV1.
    """
    done = 0
    try:
        with av.open(str(path)) as container:
            stream = container.streams.video[0]
            if stream.codec_context.name != "ffv1":
                return None
            stream.thread_type = "SLICE"  # a thread a frame would decode frames behind the last one
            stream.codec_context.thread_count = min(SLICES, os.cpu_count() or 1)
            tick = float(stream.time_base or 0)
            if start:
                container.seek(round(start / fps / tick), stream=stream)
            for packet in container.demux(stream):
                if packet.pts is None or round(packet.pts * tick * fps) < start:
                    continue
                if done == len(out) or not whole(bytes(packet)):
                    break
                for frame in packet.decode():
                    _store(frame, out[done])
                    done += 1
    except (av.error.FFmpegError, IndexError):  # no video in the file, or a packet that is none
        pass
    return done


def whole(packet: bytes) -> bool:
    """Whether all slices of a frame of FFV1 version 3 have their checksum."""
    end = len(packet)
    while end > 0:
        start = end - _TRAILER - int.from_bytes(packet[end - _TRAILER : end - _TRAILER + 3], "big")
        if end < _TRAILER or start < 0:
            return False
        # The checksum is the remainder of what lies before it: over both the remainder is 0.
        if zlib.crc32(packet[start:end].translate(_MIRROR), 0xFFFFFFFF) != 0xFFFFFFFF:
            return False
        end = start
    return len(packet) > 0


def _store(frame: av.VideoFrame, out: Array) -> None:
    """Copy a picture, bgr0 or gray16, to `out`, [H, W, 3] or [H, W]."""
    assert frame.format.name == ("bgr0" if out.ndim == 3 else "gray16le"), frame.format.name
    height, width = out.shape[:2]
    plane = frame.planes[0]
    lines = np.frombuffer(memoryview(plane), out.dtype).reshape(height, plane.line_size // out.itemsize)
    if out.ndim == 2:
        out[:] = lines[:, :width]
        return
    for channel in range(3):
        out[..., channel] = lines[:, 2 - channel : 4 * width : 4]
