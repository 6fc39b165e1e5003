"""How often a program that has no terminal says how far it is."""

import os

SIGNS = "FRACSIM_SIGNS"
"""Environment variable: seconds between two lines."""
DEFAULT = 10.0
"""Seconds between two lines, where the environment says nothing that is a number."""


def signs_every() -> float:
    """Seconds between two lines that say how far a program is; a page that shows them wants them more often."""
    try:
        return float(os.environ.get(SIGNS, ""))
    except ValueError:
        return DEFAULT
