"""Which clips of a data set go into a cache; what is left out is named, with the reason."""

from collections import Counter, defaultdict
from typing import NamedTuple

from fracgen.config.encode import EncodeConfig
from fracsim.dataset import Clip, Clips
from fracsim.dataset.table import Row

SHOWN = 3
"""Clips that are named with a reason; the others are counted."""


class Chosen(NamedTuple):
    """Clips to encode."""

    clips: list[Clip]
    fps: float
    """Their frames a second of simulated time."""
    left_out: dict[str, list[str]]
    """Ids of the others by the reason."""


def choose(clips: Clips, cfg: EncodeConfig) -> Chosen:
    """The clips that have what is asked for.

    Raises ValueError when there are none and, with `strict`, when one is left out.
    """
    fps = cfg.fps or Counter(clips.table["fps"].to_pylist()).most_common(1)[0][0] if len(clips) else cfg.fps
    good, left_out = [], defaultdict(list)
    for clip in clips:
        reason = _unfit(clip.row, cfg, fps)
        if reason:
            left_out[reason].append(str(clip.row["id"]))
        else:
            good.append(clip)
    if left_out and (cfg.strict or not good):
        raise ValueError(f"data={cfg.data}: {'; '.join(told(left_out))}. Record what is missing, or ask for less"
                         f"{': strict=false leaves such clips out' if good else ''}.")  # fmt: skip
    if not good:
        raise ValueError(f"data={cfg.data} holds no clip with numbers that can be trusted: python -m fracsim.dataset "
                         "index FOLDER says why; suspect=true takes them all.")  # fmt: skip
    return Chosen(good, fps, dict(left_out))


def told(left_out: dict[str, list[str]]) -> list[str]:
    """A line a reason: how many clips, which, and why."""
    lines = []
    for reason, ids in left_out.items():
        more = f" and {len(ids) - SHOWN} others" if len(ids) > SHOWN else ""
        lines.append(f"{len(ids)} clip(s) left out: {reason} ({', '.join(ids[:SHOWN])}{more})")
    return lines


def _unfit(row: Row, cfg: EncodeConfig, fps: float) -> str:
    """Why a clip cannot be used; empty when it can."""
    lacking = [name for name in cfg.streams if row[f"{name}_file_name"] is None]
    across, down = row["width"] / cfg.width, row["height"] / cfg.height
    if row["asset_kind"] is None:
        return "not simulated, so that its loading is unknown"
    if lacking:
        return f"recorded without {', '.join(lacking)}"
    if row["frames"] < cfg.frames:
        return f"{row['frames']} frames, fewer than frames={cfg.frames}"
    if row["fps"] != fps:
        return f"{row['fps']:g} frames a second, not {fps:g}"
    if across != down or across != int(across):
        return f"{row['width']} x {row['height']} px, no whole multiple of width={cfg.width} x height={cfg.height}"
    return ""
