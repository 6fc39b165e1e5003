"""On what something was measured: the columns that every table of figures carries."""

import datetime
import platform
import re
from pathlib import Path

from fracsim import backend
from fracsim.sample.provenance import provenance
from fracsim.scene.vocab import Backend


def machine() -> dict[str, str]:
    """The columns that are the same for all rows: hardware, versions, commit, date."""
    versions = provenance()
    commit = (versions["git_commit"] or "unknown")[:12] + ("+dirty" if versions["git_dirty"] else "")
    return {
        "cpu": cpu(),
        "cores": str(backend.threads(Backend())),
        "python": versions["python"],
        "taichi": str(versions["taichi"]),
        "numpy": str(versions["numpy"]),
        "commit": commit,
        "date": datetime.date.today().isoformat(),
    }


def cpu() -> str:
    """The model of the processor as the system names it."""
    try:
        named = re.search(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text())
    except OSError:
        named = None
    return named[1].strip() if named else platform.processor() or platform.machine()
