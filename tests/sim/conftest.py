"""All tests of this folder need Taichi."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def _started(taichi: None) -> None:
    """Taichi runs."""
