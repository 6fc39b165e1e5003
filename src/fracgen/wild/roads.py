"""The two roads from a photo to a clip, a process each: the simulator and the generator."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from fracgen.wild.photos import Pulled
from fracsim.sample import Sample, read

SHOWN = 3
"""Last lines of a command that failed."""


def simulate(one: Pulled, folder: Path, more: Sequence[str]) -> Sample:
    """The sample of a photo by `python -m fracsim`; `more` are its overrides. Raises ValueError when it fails."""
    mask = [f"asset.mask={one.mask}"] if one.mask else []
    lines = _lines("fracsim", ["asset=image", f"asset.path={one.photo}", *mask, f"condition={one.condition}",
                               "camera.background=photo", f"output.folder={folder}", *more])  # fmt: skip
    return read(_folder(lines, folder))


def generate(one: Pulled, run: Path, folder: Path, more: Sequence[str]) -> Sample:
    """The sample of a photo by `python -m fracgen.sample`; `more` are its overrides. Raises ValueError if it fails.

    The object is alone on white, as in training, unless `more` has cutout=none.
    """
    mask = [f"mask={one.mask}"] if one.mask and "cutout=none" not in more else []
    lines = _lines("fracgen.sample", [f"run={run}", f"image={one.photo}", "cutout=auto", *mask,
                                      f"condition={one.condition}", f"output.folder={folder}", *more])  # fmt: skip
    return read(_folder(lines, folder))


def _lines(module: str, arguments: Sequence[str]) -> list[str]:
    """What a command prints; raises ValueError with its last words when it fails."""
    done = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        said = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()][-SHOWN:]
        raise ValueError(f"python -m {module} ended with {done.returncode}: {' '.join(said)}")
    return done.stdout.splitlines()


def _folder(lines: Sequence[str], parent: Path) -> Path:
    """The folder of the sample that a command names: the last word with its parent in it."""
    words = [word for line in lines for word in line.split()]
    inside = [Path(word) for word in words if Path(word).parent == parent.absolute()]
    if not inside:
        raise ValueError(f"no sample was named in {parent}: {' '.join(lines[-SHOWN:])}")
    return inside[-1]
