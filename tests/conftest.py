"""Taichi starts once, for the tests that ask for it: on the CPU with two threads; scenes choose how many they use."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import pytest
from hypothesis import settings

settings.register_profile("any machine", deadline=None)  # no test is about time
settings.load_profile("any machine")


@pytest.fixture(scope="session")
def taichi() -> None:
    """Start Taichi."""
    from fracsim import Backend, backend

    backend.start(Backend(arch="cpu", threads=2))
