"""The text of `python -m PROGRAM --help`."""

import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import reduce
from operator import getitem
from textwrap import fill
from typing import Any

from fracsim.scene.knob import Knob, describe, text

FLAGS = """
Flags
  FILE.yaml        begin with the {noun} in a file, as it was written by a run
  -m, --multirun   run all combinations of values given with commas, as FIELD=VALUE,VALUE
  -c job           print the resolved {noun} and stop
  -h, --help       this text
  --hydra-help     the other flags of Hydra, the reader of the command line
"""
HARD = "\N{NO-BREAK SPACE}"
NAME = 34
"""Columns for `field=value`."""


def manual(
    about: str,
    noun: str,
    groups: Mapping[str, Sequence[str]],
    schema: type,
    values: Any,
    optional: Mapping[str, Sequence[str]] | None = None,
) -> str:
    """`about`, the flags, the choices of each group, and every field of `schema` with its value in `values`, meaning
    and allowed values. `noun` is what an object of the schema is called; `optional` are groups chosen by +GROUP=CHOICE.
    """
    width = min(max(shutil.get_terminal_size().columns, 80), 120)
    example = next((f", as {group}={choices[0]}" for group, choices in groups.items() if choices), "")
    heading = f"Groups: each choice is a file in conf/ that sets several fields{example}"
    fields_heading = f"\nFields: with their values in the default {noun}, and {{what is allowed}}"
    lines = [
        about,
        FLAGS.format(noun=noun),
        heading,
        *_groups(groups, width),
        *_groups(optional or {}, width, sign="+"),
    ]
    return "\n".join([*lines, fields_heading, *_fields(schema, values, width)]) + "\n"


def _groups(groups: Mapping[str, Sequence[str]], width: int, sign: str = "") -> Iterator[str]:
    """A line for each group of choices."""
    for group, choices in groups.items():
        how = f" (choose by {sign}{group}=NAME)" if sign else ""
        yield fill(", ".join(choices) + how, width, initial_indent=f"  {group:<9} ", subsequent_indent=" " * 12)


def _fields(schema: type, values: Any, width: int) -> Iterator[str]:
    """Every field, section by section; those without a section first."""
    titles = dict(_titles(schema))
    section = ""
    for name, _, knob in sorted(describe(schema), key=lambda entry: "." in entry[0]):
        head = name.rpartition(".")[0]
        if head != section:
            section = head
            yield "\n" + fill(f"{head}: {titles[head].splitlines()[0]}", width)
        value = text(reduce(getitem, name.split("."), values)) or '""'
        shown = f"  {name}={value}  "
        if len(shown) > NAME:
            yield shown.rstrip() if len(shown) <= width else f"{shown[: width - 4]} ..."
            shown = ""
        about = fill(_about(knob), width, initial_indent=f"{shown:<{NAME}}", subsequent_indent=" " * NAME)
        yield about.replace(HARD, " ")


def _titles(schema: type, name: str = "") -> Iterator[tuple[str, str]]:
    """Dotted name and docstring of every section below a configuration class."""
    for f in fields(schema):
        if isinstance(f.type, type) and is_dataclass(f.type):
            dotted = f"{name}.{f.name}" if name else f.name
            yield dotted, f.type.__doc__ or ""
            yield from _titles(f.type, dotted)


def _about(knob: Knob) -> str:
    """What a field means, and {what is allowed}."""
    allowed = knob.allowed()
    if not allowed:
        return knob.doc
    together = allowed.replace(" | ", "\n| ").replace(" ", HARD).replace("\n", " ")
    return f"{knob.doc} {{{together}}}"
