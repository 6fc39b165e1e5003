"""Where the weights of a metric's network lie: a field of the configuration, an environment variable, a known place."""

import hashlib
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

PART = 2**20
"""Bytes that are hashed at once."""


class MissingWeightsError(ValueError):
    """Weights or a package that a metric needs are not there; the text says which, and where users get them."""


@dataclass(frozen=True)
class Weights:
    """A file of weights, and how it is found."""

    title: str
    """What it is, as `I3D of Kinetics-400`."""
    field: str
    """The field of the configuration that holds its path, as metric.fvd.weights."""
    variable: str
    """The environment variable that holds its path."""
    size: str
    """How large it is, as `49 MB`."""
    source: str
    """Where users get it, a command or an address."""
    places: Sequence[Callable[[], Path | None]] = ()
    """Where it lies without being told, in this order."""

    def find(self, path: str = "") -> Path:
        """The file; `path` is the value of the field.

        Raises MissingWeightsError when it lies nowhere, and ValueError when the field or the variable names no file.
        """
        for name, value in ((self.field, path), (self.variable, os.environ.get(self.variable, ""))):
            if value and not Path(value).expanduser().is_file():
                raise ValueError(f"{name}={value} is no file: give {self.title} ({self.size}); {self.source}.")
            if value:
                return Path(value).expanduser()
        for place in self.places:
            found = place()
            if found is not None and found.is_file():
                return found
        raise MissingWeightsError(f"{self.title} ({self.size}) was not found: {self.source}, or set {self.field}=FILE "
                                  f"or {self.variable}.")  # fmt: skip


def sha256(path: Path) -> str:
    """The hash of a file, 64 hex digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(PART):
            digest.update(part)
    return digest.hexdigest()
