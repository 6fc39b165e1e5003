"""Warnings of the programs are for users: one line, without the place in the code."""

import warnings

import pytest

from fracsim.entry.command import warn_plainly
from fracsim.run import pipeline


def test_a_warning_is_one_line_without_the_place_in_the_code(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of other packages, and of other kinds, stay as Python shows them."""
    others = []
    monkeypatch.setattr(warnings, "showwarning", lambda message, *_: others.append(str(message)))
    warn_plainly()
    here = pipeline.__file__
    warnings.showwarning(UserWarning("the grips\n were moved"), UserWarning, here, 3)
    warnings.showwarning(DeprecationWarning("old"), DeprecationWarning, here, 4)
    warnings.showwarning(UserWarning("theirs"), UserWarning, "/home/me/fracsim/lib/other.py", 5)
    assert capfd.readouterr().err == "warning: the grips were moved\n"
    assert others == ["old", "theirs"]
