"""Inputs at the edge of what is allowed give finite numbers or are refused by name; the command tells when not."""

import numpy as np
import pytest

from fracgen.stress import __main__ as command
from fracgen.stress import network
from fracgen.stress.case import FINITE, REFUSED, WRONG, Case, Outcome, judge


@pytest.mark.parametrize("group", list(command.GROUPS))
def test_the_fast_cases_of_a_group_are_finite_or_refused_by_name(group):
    found = command.tried([group], fast=True)
    assert found
    assert [(case.name, one.reason) for case, one in found if one.verdict == WRONG] == []


def _refuse(place, folder):
    raise ValueError("steps=0 is not allowed")


def _crash(place, folder):
    raise RuntimeError("shapes do not match")


@pytest.mark.parametrize(("case", "verdict"), [
    (Case("", lambda p, f: [np.ones(3)]), FINITE),
    (Case("", lambda p, f: [np.array([1.0, np.nan])]), WRONG),
    (Case("", lambda p, f: []), WRONG),
    (Case("", _refuse, refusal="steps=0"), REFUSED),
    (Case("", _refuse, refusal="guidance"), WRONG),
    (Case("", _refuse), WRONG),
    (Case("", _crash, refusal="shapes"), WRONG),
    (Case("", lambda p, f: [np.ones(3)], refusal="steps=0"), WRONG),
    (Case("", lambda p, f: [np.ones(3)], refusal="steps=0", either=True), FINITE),
])  # fmt: skip
def test_only_finite_numbers_and_refusals_that_name_the_fault_are_right(case, verdict, tmp_path):
    assert judge(case, None, tmp_path / "case").verdict == verdict


def test_the_command_prints_all_cases_and_fails_when_one_is_wrong(monkeypatch, capsys):
    bad = [(Case("good", network.weights), Outcome(FINITE, "", 0.1)), (Case("bad", network.weights),
            Outcome(WRONG, "numbers [nan]", 0.1))]  # fmt: skip
    monkeypatch.setattr(command, "tried", lambda *_: bad)
    assert command.main([]) == 1
    told = capsys.readouterr().out
    assert all(word in told for word in ("good", "bad", "WRONG", "numbers [nan]", "2 cases, 1 wrong"))
    monkeypatch.setattr(command, "tried", lambda *_: bad[:1])
    assert command.main([]) == 0


def test_an_unknown_group_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["disk"])
    assert "GROUP=disk is not known: choose from network, videos, training, sampling" in capsys.readouterr().err
