"""Taichi starts once a process, for the tests that ask for it: on the CPU with two threads; scenes choose fewer.

With `-n` processes run folders side by side; a folder stays together, since its tests share what they have made. Under
pytest 9.2 pytest-xdist 3.8 loses the groups, so that an older one is asked for.
"""

import os
from pathlib import Path

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import pytest
from hypothesis import settings

settings.register_profile("any machine", deadline=None)  # no test is about time
settings.load_profile("any machine")


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give the tests of a folder to one process."""
    here = Path(__file__).parent
    for item in items:
        item.add_marker(pytest.mark.xdist_group(item.path.relative_to(here).parts[0]))


@pytest.fixture(scope="session")
def taichi() -> None:
    """Start Taichi."""
    from fracsim import Backend, backend

    backend.start(Backend(arch="cpu", threads=2))
