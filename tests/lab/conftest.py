"""Taichi starts once for these tests, on the CPU with two threads; scenes choose how many of them to use."""

import pytest

from fracsim import Backend, backend


@pytest.fixture(scope="session", autouse=True)
def taichi() -> None:
    backend.start(Backend(arch="cpu", threads=2))
