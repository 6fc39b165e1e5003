"""The versions and the machine behind a sample."""

import platform
import subprocess
from collections.abc import Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from fracsim.version import __version__

PACKAGES = ("taichi", "numpy", "trimesh", "imageio-ffmpeg")
"""Distributions that shape a simulated sample."""


def provenance(
    producer: str = "fracsim", producer_version: str = __version__, packages: Sequence[str] = PACKAGES
) -> dict[str, Any]:
    """Versions of the producer, of fracsim (it writes the files) and of `packages`, None for one that is not installed.

    Also the platform, and the commit when run from a checkout.
    """
    return {
        "fracsim": __version__,
        producer: producer_version,
        **{name: _version(name) for name in packages},
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": platform.processor() or platform.machine(),
        **_checkout(Path(__file__).parents[3]),
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


@cache
def _checkout(root: Path) -> dict[str, Any]:
    """Commit, and whether the sources differ from it; both None when `root` is not a git checkout."""
    if not (root / ".git").exists():
        return {"git_commit": None, "git_dirty": None}
    commit = _git(root, "rev-parse", "--verify", "-q", "HEAD")
    changes = _git(root, "status", "--porcelain", "--", "src", "conf")
    return {"git_commit": commit or None, "git_dirty": None if changes is None else bool(changes)}


def _git(root: Path, *arguments: str) -> str | None:
    command = ["git", "--no-optional-locks", "-C", str(root), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
