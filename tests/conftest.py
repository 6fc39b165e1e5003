"""Taichi starts once for all tests, on the CPU with two threads; scenes choose how many of them to use."""

import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import pytest

from fracsim import Backend, backend


@pytest.fixture(scope="session", autouse=True)
def taichi() -> None:
    backend.start(Backend(arch="cpu", threads=2))
