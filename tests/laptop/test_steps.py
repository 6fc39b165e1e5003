"""`python -m fracgen.laptop`: its programs accept the commands that it prints, and each reads what one before wrote."""

import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from fracgen.encode import ENCODE
from fracgen.evaluate import EVALUATE
from fracgen.laptop.__main__ import main
from fracgen.laptop.running import typed
from fracgen.laptop.steps import Command, Step, steps
from fracgen.laptop.study import FRAMES, FULL, QUICK, SIMULATORS, WIDTH, Study, Variant
from fracgen.sample import SAMPLE
from fracgen.train import TRAIN
from fracgen.train_vae import PROGRAM as TRAIN_VAE
from fracsim.scene.classes import TEST
from fracsim.scene.program import SIMULATE

ROOT = Path(__file__).parents[2]
PROGRAMS: dict[str, Any] = {"fracsim": SIMULATE, "fracgen.train_vae": TRAIN_VAE, "fracgen.encode": ENCODE,
                            "fracgen.train": TRAIN, "fracgen.sample": SAMPLE, "fracgen.evaluate": EVALUATE}  # fmt: skip


def scenes(command: Command) -> Iterator[list[str]]:
    """The overrides of the first and of the last scene of a sweep."""
    for which in (0, -1):
        yield [_one(override, which) for override in command[1:] if not override.startswith("hydra")]


def _one(override: str, which: int) -> str:
    """One of the values of an override."""
    name, _, value = override.partition("=")
    if span := re.fullmatch(r"range\((\d+),(\d+)\)", value):
        return f"{name}={(int(span[1]), int(span[2]) - 1)[which]}"
    return f"{name}={value.split(',')[which]}"


@cache
def composed(command: Command) -> list[Any]:
    """The configurations of a command; raises ValueError for what its program does not accept."""
    program = PROGRAMS[command[0]]
    every = scenes(command) if command[0] == "fracsim" else [list(command[1:])]
    return [program.compose(*overrides) for overrides in every]


def commands(study: Study, module: str) -> list[Any]:
    """The configurations of all commands of a program; the first scene of each sweep."""
    return [composed(command)[0] for step in steps(study) for command in step.commands if command[0] == module]


@pytest.mark.parametrize("study", [FULL, QUICK], ids=["full", "quick"])
def test_programs_accept_all_commands(study: Study) -> None:
    for step in steps(study):
        for command in step.commands:
            assert composed(command)


def test_what_is_typed_is_what_runs() -> None:
    """A shell splits it into the same words, but for the name that a training gets from its hash."""
    for step in steps(FULL):
        for command in step.commands:
            words = shlex.split(typed(command))
            assert words[:3] == ["python", "-m", command[0]]
            plain = [re.sub(r"\$\(ls -td (.*) \| head -n 1\)", r"\1", word) for word in words[3:]]
            assert plain == list(command[1:])


def test_each_step_reads_what_one_before_has_written() -> None:
    (vae,), (cache,) = commands(FULL, "fracgen.train_vae"), commands(FULL, "fracgen.encode")
    clips, *more = dict.fromkeys(scene.output.folder for scene in commands(FULL, "fracsim"))
    assert vae.data == cache.data == clips
    assert cache.vae.path == vae.output.folder
    assert (cache.vae.kind, cache.vae.base_dim) == (vae.vae.kind, vae.vae.base_dim)
    for training in commands(FULL, "fracgen.train"):
        assert training.data.folder == cache.output.folder
    written = {clips, *more}
    for sampling in commands(FULL, "fracgen.sample"):
        assert sampling.data in written
        assert (sampling.vae, sampling.encoders) == (cache.vae, cache.encoders)
        written.add(sampling.output.folder)
    for evaluation in commands(FULL, "fracgen.evaluate"):
        assert {evaluation.pred, evaluation.gt} <= written


def test_runs_are_found_where_trainings_put_them() -> None:
    folders = {f"{t.output.folder}/stage{t.stage}-*" for t in commands(FULL, "fracgen.train")}
    assert {FULL.run(variant) for variant in FULL.variants} == folders
    assert {s.run for s in commands(FULL, "fracgen.sample")} <= folders


def test_latents_have_the_size_of_the_clips() -> None:
    (cache,) = commands(FULL, "fracgen.encode")
    scene = commands(FULL, "fracsim")[0]
    assert (cache.width, cache.height, cache.frames) == (WIDTH, WIDTH, FRAMES)
    assert (scene.camera.width, scene.camera.height, scene.capture.frames) == (WIDTH, WIDTH, FRAMES)


def test_stages_differ_in_their_streams_and_losses_only() -> None:
    """Equal steps, learning rates and warm-ups; the control differs from stage 3 in lambda_const alone."""
    one = commands(FULL, "fracgen.train")[0]
    recipes = [one.stages.stage1, one.stages.stage2, one.stages.stage3]
    assert {recipe.steps for recipe in recipes} == {FULL.steps}
    assert len({(recipe.lr, recipe.warmup) for recipe in recipes}) == 1
    for seed in range(FULL.seeds):
        last = [t for t in commands(FULL, "fracgen.train") if t.stage == 3 and t.seed == seed]
        stage3, control = sorted(last, key=lambda t: -float(t.loss.lambda_const))
        assert (control.loss.lambda_const, stage3.loss.lambda_const) == (0, 0.1)
        assert control.init_from == FULL.run(Variant("stage2", 2, seed))


def test_there_are_enough_clips_of_both_classes_and_held_out_objects_have_their_own_draws() -> None:
    counts = len(FULL.train_objects) * FULL.train_draws + len(FULL.test_objects) * FULL.test_draws
    assert counts > FULL.least >= 160
    assert set(FULL.test_objects) == set(TEST)
    training, testing = steps(FULL)[0].commands[:2]
    assert f"draw=range(0,{FULL.train_draws})" in training
    assert f"draw=range({FULL.train_draws}," in " ".join(testing)


def test_solvers_differ_in_what_solvers_are() -> None:
    for overrides in SIMULATORS.values():
        assert all(override.startswith("solver.") for override in overrides)


def test_it_fits_into_three_hours() -> None:
    assert sum(step.minutes for step in steps(FULL)) < 180


def test_the_makefile_runs_it() -> None:
    text = (ROOT / "Makefile").read_text()
    assert re.search(r"^laptop:.*\n\t\$\(RUN\) fracgen\.laptop$", text, re.MULTILINE)
    assert "docs/laptop.md" in (ROOT / "README.md").read_text()


def test_the_page_names_all_steps_with_their_minutes() -> None:
    page = (ROOT / "docs/laptop.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| ([\d.]+) \|$", page, re.MULTILINE))
    assert rows == {step.name: f"{step.minutes:g}" for step in steps(FULL)}


def test_list_prints_all_commands_and_runs_none(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["--list", "--folder", str(tmp_path / "study")]) == 0
    printed = capsys.readouterr().out
    every: list[Step] = steps(FULL)
    assert printed.count("python -m ") == sum(len(step.commands) for step in every)
    assert not (tmp_path / "study").exists()


def test_an_unknown_step_is_refused_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--only", "trian1"])
    assert "trian1 is no step: choose from simulate, vae" in capsys.readouterr().err
