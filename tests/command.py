"""The command line in a process of its own, and scenes small enough for it."""

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import fracsim

SMALL = ("solver.cells=40", "capture.frames=4", "camera.width=64", "camera.height=64", "capture.tracks=16")
"""A bread of about two thousand particles, three frames of motion, 64 x 64 pixels."""


def environment(**more: str) -> dict[str, str]:
    """The environment of a process that finds this very package."""
    return {**os.environ, "PYTHONPATH": str(Path(fracsim.__file__).parents[1]), "COLUMNS": "100", **more}


def start(*arguments: str, **options: Any) -> "subprocess.Popen[str]":
    """`python -m fracsim ARGUMENTS`, started."""
    return subprocess.Popen([sys.executable, "-m", "fracsim", *arguments], env=environment(), text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)  # fmt: skip


def fracsim_command(*arguments: str, **options: Any) -> "subprocess.CompletedProcess[str]":
    """`python -m fracsim ARGUMENTS`, run to its end; signs of life are left out of its stderr."""
    process = start(*arguments, **options)
    out, err = process.communicate(timeout=400)
    return subprocess.CompletedProcess(arguments, process.returncode, out, complaints(err))


def python(code: str) -> str:
    """What `python -c CODE` prints; it must not fail."""
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def complaints(err: str) -> str:
    """What stands on stderr besides signs of life, which come when the machine is busy or new."""
    return "".join(line for line in err.splitlines(True) if not re.match(r"frame \d+ of |compiling kernels", line))


def samples(folder: Path) -> list[Path]:
    """The samples in a folder, finished or not, by age."""
    return sorted((p.parent for p in folder.glob("*/meta.json")), key=lambda p: p.stat().st_mtime)
