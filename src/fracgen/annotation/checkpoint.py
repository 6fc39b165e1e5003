"""What the page must know of a checkpoint, read without torch: the size of its clips."""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from fracgen.annotation.preview import Size

FILE = "trained.safetensors"
"""Name of the file in the folder of a run."""


def size(run: str) -> Size:
    """The size of the clips of a run.

    Raises ValueError for a folder without a checkpoint, and where torch, which samples from it, is not installed.
    """
    if find_spec("torch") is None or find_spec("safetensors") is None:
        raise ValueError("--run needs torch: pip install 'fracsim[gen]' (Python 3.11 or later).")
    file = Path(run).expanduser()
    file = file / FILE if file.is_dir() else file
    if not file.is_file():
        raise ValueError(f"--run {run} has no {FILE}: give the folder of a finished training, as runs/stage3-ID.")
    cache = _about(file).get("cache") or {}
    try:
        return Size(int(cache["frames"]), int(cache["height"]), int(cache["width"]), float(cache["fps"]))
    except (KeyError, TypeError, ValueError):
        raise ValueError(f"--run {run} does not say how large its clips are: give a run of this version.") from None


def _about(file: Path) -> dict[str, Any]:
    """What a checkpoint says about itself; raises ValueError for a file that is none."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(file, framework="numpy") as content:
            about = json.loads((content.metadata() or {}).get("about", "null"))
    except (SafetensorError, OSError, ValueError) as error:
        raise ValueError(f"--run: {file} cannot be read ({error}): give the folder of a finished training.") from None
    if not isinstance(about, dict):
        raise ValueError(f"--run: {file} is no checkpoint of fracgen: give the folder of a finished training.")
    return about
