"""A case, and what came of it: finite numbers, a refusal that names what is wrong, or neither, which is wrong."""

import contextlib
import io
import re
import time
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from torch import Tensor

from fracgen.stress.place import Place
from fracsim.records import Array

Work = Callable[[Place, Path], Iterable[Tensor | Array]]
"""Takes what all cases share and an empty folder; gives what must be finite."""
FINITE, REFUSED, WRONG = "finite", "refused", "WRONG"


@dataclass(frozen=True)
class Case:
    """Something to try."""

    name: str
    work: Work
    refusal: str = ""
    """Regular expression of the refusal, with the field that it must name; empty: it must not be refused."""
    either: bool = False
    """Finite numbers are right, too."""
    slow: bool = False
    """Left out by --fast."""


@dataclass(frozen=True)
class Outcome:
    """What came of a case."""

    verdict: str
    """FINITE, REFUSED or WRONG."""
    reason: str
    """The refusal, or what is wrong."""
    seconds: float


def judge(case: Case, place: Place, folder: Path) -> Outcome:
    """Try a case, with `folder` for what it writes; an exception that is no refusal is wrong."""
    folder.mkdir(parents=True)
    begin = time.perf_counter()
    verdict, reason = _judged(case, place, folder)
    return Outcome(verdict, reason, time.perf_counter() - begin)


def _judged(case: Case, place: Place, folder: Path) -> tuple[str, str]:
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(
            io.StringIO()
        ):  # fmt: skip
            warnings.simplefilter("ignore")
            values = [np.asarray(value) for value in case.work(place, folder)]
    except (ValueError, OSError) as error:
        named = bool(case.refusal) and re.search(case.refusal, str(error)) is not None
        return (REFUSED if named else WRONG), str(error)
    except Exception as error:  # whatever it is, it is not a refusal
        return WRONG, f"{type(error).__name__}: {error}"
    if case.refusal and not case.either:
        return WRONG, "it was accepted"
    if not values or not all(np.isfinite(value).all() for value in values):
        return WRONG, "numbers that are not finite" if values else "no numbers"
    return FINITE, ""
