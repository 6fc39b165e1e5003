"""How the commands of the laptop study run: two at a time, never twice, and what is told when one fails."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any

import pytest

from fracgen.laptop import running
from fracgen.laptop.running import FailedError, Journal, Runner, all_steps, resolved, typed
from fracgen.laptop.steps import Step

STEP = Step("train1", "stage 1", tuple(("fracgen.train", f"seed={k}") for k in range(3)), 5.0)


@dataclass
class Machine:
    """Stands in for processes: each ends at the second look, with the status that its command asks for."""

    started: list[list[str]] = field(default_factory=list)
    alive: int = 0
    most: int = 0
    threads: set[str] = field(default_factory=set)

    def __call__(self, argv: Sequence[str], stdout: IO[str], env: dict[str, str], **more: Any) -> "Process":
        self.started.append(list(argv[2:]))
        self.alive += 1
        self.most = max(self.most, self.alive)
        self.threads.add(env["OMP_NUM_THREADS"])
        stdout.write("first\n\nlast words\n")
        return Process(self, 3 if "fail=true" in argv else 0)


@dataclass
class Process:
    machine: Machine
    status: int
    looks: int = 0
    returncode: int | None = None

    def poll(self) -> int | None:
        self.looks += 1
        if self.looks >= 2 and self.returncode is None:
            self.returncode = self.status
            self.machine.alive -= 1
        return self.returncode

    def terminate(self) -> None:
        self.returncode = -15

    def wait(self) -> int | None:
        return self.returncode


@pytest.fixture
def runner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Runner:
    monkeypatch.setattr(running, "POLL", 0.0)
    return Runner(tmp_path / "logs", Machine())


def test_two_commands_run_at_a_time_with_a_thread_each(runner: Runner) -> None:
    machine: Any = runner.start
    assert runner.run(STEP) == 0
    assert machine.started == [["fracgen.train", f"seed={k}"] for k in range(3)]
    assert machine.most == 2
    assert machine.threads == {"1"}


def test_a_command_that_takes_all_cores_runs_alone(runner: Runner) -> None:
    machine: Any = runner.start
    runner.run(replace(STEP, together=False))
    assert machine.most == 1
    runner.run(replace(STEP, commands=STEP.commands[:1]))
    assert machine.threads == {"2"}


def test_a_finished_step_is_not_run_again_but_other_commands_are(runner: Runner, tmp_path: Path) -> None:
    machine, journal = runner.start, Journal(tmp_path / "steps")
    assert isinstance(machine, Machine)
    for _ in range(2):
        assert all_steps([STEP], journal, runner)
    assert len(machine.started) == 3
    other = replace(STEP, commands=(("fracgen.train", "seed=0", "stages.stage1.steps=9"),))
    assert all_steps([other], journal, runner)
    assert len(machine.started) == 4
    assert all_steps([other], journal, runner, again=True)
    assert len(machine.started) == 5
    gone = replace(STEP, commands=(("fracgen.encode", f"output.folder={tmp_path}/latents"),))
    for _ in range(2):  # what was written is not there
        assert all_steps([gone], journal, runner)
    assert len(machine.started) == 7


def test_a_failure_is_told_with_its_last_words_and_ends_the_study(
    runner: Runner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    journal = Journal(tmp_path / "steps")
    bad = replace(STEP, commands=(("fracgen.train", "fail=true"),))
    after = replace(STEP, name="sample")
    assert not all_steps([bad, after], journal, runner)
    told = capsys.readouterr().err
    assert "train1: a command ended with 3" in told
    assert "last words" in told
    assert "train1-0.log" in told
    assert journal.read(bad) is None
    assert len(runner.start.started) == 1  # type: ignore[attr-defined]


def test_a_sweep_may_fail_in_part_when_what_it_made_is_enough(runner: Runner) -> None:
    bad = replace(STEP, commands=(("fracsim", "fail=true"), ("fracsim",)), enough=lambda: "")
    assert runner.run(bad) == 1
    with pytest.raises(FailedError, match="train1: 7 clips are too few"):
        runner.run(replace(bad, enough=lambda: "7 clips are too few"))


def test_processes_are_told_to_end_when_the_study_is_interrupted(
    runner: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(seconds: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(running.time, "sleep", interrupt)
    with pytest.raises(KeyboardInterrupt):
        runner.run(STEP)
    assert runner.running == []


def test_a_pattern_becomes_the_finished_run_that_fits_it(tmp_path: Path) -> None:
    pattern = f"run={tmp_path}/stage1-*"
    with pytest.raises(FailedError, match="is no finished training"):
        resolved(("fracgen.sample", pattern))
    (tmp_path / "stage1-0123").mkdir()  # begun
    (tmp_path / "stage1-4567").mkdir()
    (tmp_path / "stage1-4567" / "run.json").write_text("{}")
    assert resolved(("fracgen.sample", pattern, "batch=4")) == (
        "fracgen.sample",
        f"run={tmp_path}/stage1-4567",
        "batch=4",
    )
    assert (
        typed(("fracgen.sample", "run=a/stage1-*")) == 'python -m fracgen.sample run="$(ls -td a/stage1-* | head -n 1)"'
    )
