"""Where files lie that may be deleted at any time: prepared objects, compiled kernels."""

import os
import tempfile
from pathlib import Path


def folder() -> Path:
    """$FRACSIM_CACHE, else fracsim in `base`."""
    given = os.environ.get("FRACSIM_CACHE")
    return Path(given).expanduser() if given else base() / "fracsim"


def base() -> Path:
    """$XDG_CACHE_HOME, else ~/.cache, also without $HOME; without a home, a temporary folder."""
    try:
        return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # no HOME, and a user without an entry, as in some containers
        return temporary()


def temporary() -> Path:
    """The folder that is used when the other one cannot be written to; each user has one."""
    return Path(tempfile.gettempdir()) / f"fracsim-{os.getuid() if hasattr(os, 'getuid') else 'cache'}"


def writable(path: Path) -> bool:
    """Whether files can be made in a folder, which is made if it is not there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path):
            return True
    except OSError:
        return False
