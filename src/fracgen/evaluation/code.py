"""The code that an observation rests on: a file and all of this package that it imports, as a hash."""

import ast
import hashlib
from collections.abc import Iterator
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path

PACKAGE = "fracgen"


def digest(*files: Path) -> str:
    """The hash of files and of the files of this package that they import, 64 hex digits."""
    found: dict[Path, str] = {}
    waiting = list(files)
    while waiting:
        file = waiting.pop()
        if file not in found:
            source = file.read_bytes()
            found[file] = hashlib.sha256(source).hexdigest()
            waiting += _imported(source)
    return hashlib.sha256(repr(sorted(found.values())).encode()).hexdigest()


def _imported(source: bytes) -> Iterator[Path]:
    """The files of the modules of this package that a source imports."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == PACKAGE:
            for name in (str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)):
                with suppress(ModuleNotFoundError):  # a name in a module
                    spec = find_spec(name)
                    if spec is not None and spec.origin:
                        yield Path(spec.origin)
