"""Taichi starts once for all tests, on the CPU with two threads; scenes choose how many of them to use."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import pytest
from hypothesis import settings

from fracsim import Backend, backend

settings.register_profile("any machine", deadline=None)  # no test is about time
settings.load_profile("any machine")


@pytest.fixture(scope="session", autouse=True)
def taichi() -> None:
    backend.start(Backend(arch="cpu", threads=2))
