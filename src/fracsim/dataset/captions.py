"""Captions: one template a material class, filled from the row of a clip; equal rows give equal captions."""

from collections.abc import Mapping
from typing import Any

from fracsim.scene.classes import NONE

TEMPLATES = {
    "low_stretch": "A {object} of a soft material that stretches little is pulled{direction}{end}.",
    "high_stretch": "A {object} of a rubber-like material that stretches far is pulled{direction}{end}.",
    NONE: "A {object} is pulled{direction}{end}.",
}
PLAIN = {"bread": "loaf of bread"}
"""Plain names of objects whose own name is none."""


def caption(row: Mapping[str, Any]) -> str:
    """The caption of a row of the table; reads object, class, loading_axis_deg, break_frame, torn_frame and frames."""
    return _filled(row, _end(row))


def prompt(row: Mapping[str, Any]) -> str:
    """As `caption`, but without what happens: what a generator may be told. Reads object, class, loading_axis_deg."""
    return _filled(row, "")


def _filled(row: Mapping[str, Any], end: str) -> str:
    """The template of the class of a row."""
    name = PLAIN.get(row["object"], str(row["object"]).replace("_", " "))
    text = TEMPLATES[row["class"]].format(object=name, direction=direction(row["loading_axis_deg"]), end=end)
    return text.replace("A ", "An ", 1) if name[:1].lower() in "aeiou" else text


def direction(axis_deg: float | None) -> str:
    """A pulling axis [deg], counter-clockwise from image right, in words; equal to that 180 deg further."""
    if axis_deg is None:
        return ""
    axis = axis_deg % 180
    if axis in (0, 90):
        return " horizontally" if axis == 0 else " vertically"
    return f" along an axis {axis:g} degrees counter-clockwise from the horizontal"


def _end(row: Mapping[str, Any]) -> str:
    """What happens within the frames of the clip."""
    if row["break_frame"] is not None:
        return " and breaks"
    return " and holds" if row["torn_frame"] is None and row["particles"] is not None else ""
