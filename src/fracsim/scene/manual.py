"""The text of `python -m fracsim --help`."""

import shutil
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from textwrap import fill

from fracsim import registry
from fracsim.scene.knob import Knob, describe, text
from fracsim.scene.vocab import Scene

PLUGINS = {"material.law": "fracsim.constitutive", "fracture.law": "fracsim.damage", "capture.maps": "fracsim.maps"}
"""Fields that name a module of a package."""

HEADER = """\
Pull an object until it tears and film it, with pixel-aligned maps of flow,
strain, stress and damage.

Usage: python -m fracsim [FLAGS] [GROUP=CHOICE ...] [FIELD=VALUE ...]

  python -m fracsim                                       a loaf of bread, into outputs/
  python -m fracsim asset=duck loading.axis_deg=30        a built-in rubber duck
  python -m fracsim asset=mesh asset.path=FILE.glb material=rubber
  python -m fracsim asset=ply asset.path=point_cloud.ply  a trained 3DGS checkpoint
  python -m fracsim quality=preview capture.maps=[damage] capture.rgb=false
  python -m fracsim -m material.E=2e3,6e3                 several scenes in one process

A scene whose sample is already there is not run again: to go on after an
interruption, repeat the command.

Flags
  -m, --multirun   run all combinations of values given with commas, as material.E=2e3,6e3
  -c job           print the resolved scene and stop
  -h, --help       this text
  --hydra-help     what Hydra, which reads the command line, can do beside this
"""
HARD = "\N{NO-BREAK SPACE}"
NAME = 34
"""Columns for `field=value`."""


def manual(folder: Path, scene: Scene) -> str:
    """Groups in the folder of YAML files, and every field with its value in `scene`, meaning and allowed values."""
    width = min(max(shutil.get_terminal_size().columns, 80), 120)
    groups = "Groups: each choice is a file in conf/ that sets several fields, as asset=duck"
    heading = "\nFields: with their values in the default scene, and {what is allowed}"
    lines = [HEADER, groups, *_groups(folder, width), heading, *_fields(scene, width)]
    return "\n".join(lines) + "\n"


def _groups(folder: Path, width: int) -> Iterator[str]:
    """A line a group of choices."""
    for group in sorted(p for p in folder.iterdir() if p.is_dir()):
        choices = ", ".join(sorted(p.stem for p in group.glob("*.yaml")))
        yield fill(choices, width, initial_indent=f"  {group.name:<10}", subsequent_indent=" " * 12)


def _fields(scene: Scene, width: int) -> Iterator[str]:
    """Every field, section by section."""
    titles = {f.name: f.type.__doc__ for f in fields(Scene) if isinstance(f.type, type) and is_dataclass(f.type)}
    section = ""
    for name, _, knob in describe(Scene):
        head, _, leaf = name.rpartition(".")
        if head != section:
            section = head
            yield "\n" + fill(f"{head}: {(titles[head] or '').splitlines()[0]}", width)
        value = text(getattr(getattr(scene, head) if head else scene, leaf)) or '""'
        shown = f"  {name}={value}  "
        if len(shown) > NAME:
            yield shown.rstrip()
            shown = ""
        about = fill(_about(name, knob), width, initial_indent=f"{shown:<{NAME}}", subsequent_indent=" " * NAME)
        yield about.replace(HARD, " ")


def _about(name: str, knob: Knob) -> str:
    """What a field means, and {what is allowed}."""
    allowed = " | ".join(registry.names(PLUGINS[name])) if name in PLUGINS else knob.allowed()
    if not allowed:
        return knob.doc
    together = allowed.replace(" | ", "\n| ").replace(" ", HARD).replace("\n", " ")
    return f"{knob.doc} {{{together}}}"
