"""A sample in a notebook: what it is, and its film inline."""

from base64 import b64encode
from html import escape
from pathlib import Path

MOST_BYTES = 20_000_000
"""Largest film that goes into a notebook; the default scene has 0.2 MB."""


def html(text: str, film: Path) -> str:
    """`text` and, below it, the film of a file, which becomes part of the page; without one, the text alone."""
    about = f"<pre>{escape(text)}</pre>"
    try:
        if film.stat().st_size > MOST_BYTES:
            return about
        data = b64encode(film.read_bytes()).decode()
    except OSError:
        return about
    return f'{about}<video src="data:video/mp4;base64,{data}" controls loop muted style="max-width: 100%"></video>'
