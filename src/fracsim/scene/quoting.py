"""Paths on the command line: what Hydra's grammar would not read as it is written is put in quotes."""

import re
from collections.abc import Sequence
from pathlib import Path

PATHS = ("path", "folder", "law", "pred", "gt", "mask", "cutout", "condition", "image")
"""Ends of the names of fields that hold a path."""


def quoted(overrides: Sequence[str]) -> list[str]:
    """The overrides, those of paths quoted where they would not be read as they are written.

    A path with a comma is one path if it is a file, and several, for a sweep, if its parts are.
    """
    return [_path(o) if re.match(r"\+*[\w.]+=", o) else o for o in overrides]


def quote(value: str) -> str:
    """A value in the quotes of Hydra's grammar: a quote in it needs a backslash, and backslashes before it another."""
    inner = re.sub(r"(\\*)'", lambda m: m[1] * 2 + r"\'", value)
    tail = "\\" * (len(inner) - len(inner.rstrip("\\")))
    return f"'{inner}{tail}'"


def _path(override: str) -> str:
    """An override whose value is quoted if it is a path that needs it."""
    field, _, value = override.partition("=")
    if (
        field.rpartition(".")[2] not in PATHS
        or not value
        or value[0] in "'\""
        or re.fullmatch(r"[\w./-]+", value, re.A)
    ):
        return override
    parts = value.split(",")
    if len(parts) > 1 and not _file(value) and all(_file(p) for p in parts):
        return f"{field}={','.join(quote(p) for p in parts)}"
    return f"{field}={quote(value)}" if _file(value) or not _readable(override) else override


def _file(value: str) -> bool:
    """Whether a value names something on disk."""
    try:
        return Path(value).expanduser().exists()
    except (OSError, RuntimeError, ValueError):
        return False


def _readable(override: str) -> bool:
    """Whether Hydra's grammar reads an override."""
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    try:
        OverridesParser.create().parse_override(override)
    except HydraException:
        return False
    return True
