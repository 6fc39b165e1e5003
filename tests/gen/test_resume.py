"""A run that was killed or stopped, and goes on, gives the losses and weights of one that was not: bit for bit.

On one thread of a CPU the same operations run in the same order, so that nothing but equality is right.
"""

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file

from fracgen.training import saving, stages
from fracgen.training.module import Module
from tests.command import environment
from tests.gen.trainings import cache, config, curves, only, overrides

MORE = ("trainer.save_steps=1", "trainer.ema=0.9", "conditioning.drop_text=0.3", "conditioning.drop_reference=0.3")


@pytest.fixture(scope="module")
def latents(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return cache(tmp_path_factory.mktemp("latents"))


@pytest.fixture(scope="module")
def whole(latents: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nothing interrupts; its three epochs have two steps each."""
    torch.set_num_threads(1)
    folder = tmp_path_factory.mktemp("whole")
    stages.run(config(folder, latents, *MORE))
    return only(folder)


def assert_same(run: Path, whole: Path) -> None:
    """Curves and weights are equal."""
    assert curves(run) == curves(whole)
    weights, expected = (load_file(folder / "trained.safetensors") for folder in (run, whole))
    assert weights.keys() == expected.keys()
    assert all(torch.equal(weights[name], expected[name]) for name in weights)


def stopped_at(monkeypatch: pytest.MonkeyPatch, hook: str, call: int, do: Callable[[], None]) -> None:
    """Let `do` happen in the given call of a hook of the module, counted from 0."""
    original, calls = getattr(Module, hook), [0]

    def wrapped(self: Module, *args: Any) -> Any:
        calls[0] += 1
        if calls[0] == call + 1:
            do()
        return original(self, *args)

    monkeypatch.setattr(Module, hook, wrapped)


def terminate() -> None:
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.mark.parametrize("passes", [4, 9, 14, 23])
def test_a_signal_stops_after_the_forward_pass_and_the_run_goes_on_exactly(
    passes: int, latents: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the first, second and third forward pass of an optimiser step of four, and the last one of all: the pass ends,
    the checkpoint has the last whole step, and what was accumulated is computed again."""
    with monkeypatch.context() as patch:
        stopped_at(patch, "training_step", passes, terminate)
        with pytest.raises(saving.Stopped):
            stages.run(config(tmp_path, latents, *MORE, "trainer.save_steps=1000"))
    assert not (only(tmp_path) / "run.json").exists()
    content = torch.load(only(tmp_path) / "last.ckpt", weights_only=True)
    assert content["fracgen"]["step"] == (passes + 1) // 4
    stages.run(config(tmp_path, latents, *MORE))
    assert_same(only(tmp_path), whole)


def test_an_error_in_an_optimiser_step_goes_on_from_the_last_checkpoint(
    latents: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the middle of the second epoch, two workers reading ahead, another batch size and other workers behind."""

    def fail() -> None:
        raise OSError("no space")

    with monkeypatch.context() as patch:
        stopped_at(patch, "on_before_optimizer_step", 3, fail)
        with pytest.raises(OSError, match="no space"):
            stages.run(config(tmp_path, latents, *MORE, "data.workers=2"))
    stages.run(config(tmp_path, latents, *MORE, "data.workers=1"))
    assert_same(only(tmp_path), whole)


def test_a_validation_that_was_broken_off_is_repeated_whole(
    latents: Path, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three clips at two noise levels are six passes, also after the run goes on."""
    with monkeypatch.context() as patch:
        stopped_at(patch, "validation_step", 4, terminate)  # the second clip of the second validation
        with pytest.raises(saving.Stopped):
            stages.run(config(tmp_path, latents, *MORE))
    stages.run(config(tmp_path, latents, *MORE))
    rows = curves(only(tmp_path))
    assert [row.get("val/passes") for row in rows.values()] == [None, 6, None, 6, None, 6]
    assert_same(only(tmp_path), whole)


def test_the_learning_rate_follows_optimiser_steps_whatever_the_accumulation(
    latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Linear over two steps, then a cosine over the other four; four forward passes a step before the stop, two
    behind it."""
    with monkeypatch.context() as patch:
        stopped_at(patch, "training_step", 13, terminate)
        with pytest.raises(saving.Stopped):
            stages.run(config(tmp_path, latents))
    stages.run(config(tmp_path, latents, "trainer.batch=2"))
    expected = [0.5, 1.0, *(0.5 * (1 + math.cos(math.pi * k / 4)) for k in range(4))]
    rates = [row["lr"] / 1e-3 for row in curves(only(tmp_path)).values()]
    assert rates == pytest.approx(expected, rel=1e-7)  # nine digits are written


def test_a_killed_process_with_two_workers_goes_on_exactly(latents: Path, whole: Path, tmp_path: Path) -> None:
    """kill -9 in the middle of an epoch, by the command line."""
    command = [sys.executable, "-m", "fracgen.train", *overrides(tmp_path, latents, *MORE, "data.workers=2")]
    process = subprocess.Popen(command, env=environment(OMP_NUM_THREADS="1"), stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, start_new_session=True)  # fmt: skip
    assert process.stderr is not None
    for line in process.stderr:
        if "step 3/6" in line:
            break
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    time.sleep(0.1)
    done = subprocess.run(command, env=environment(OMP_NUM_THREADS="1"), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "step 2 of 6" in done.stdout or "step 3 of 6" in done.stdout
    assert_same(only(tmp_path), whole)


def test_a_checkpoint_holds_what_was_trained_only(latents: Path, tmp_path: Path) -> None:
    """With LoRA on a base in bfloat16: adapters, in float32, and nothing of the base."""
    more = ("model.train=lora", "trainer.precision=bf16-mixed", "trainer.base_dtype=bfloat16", "stages.stage1.steps=2")
    stages.run(config(tmp_path, latents, *more))
    content = torch.load(only(tmp_path) / "last.ckpt", weights_only=True)
    assert content["state_dict"]
    assert all(".lora_" in name and t.dtype == torch.float32 for name, t in content["state_dict"].items())
    assert content["fracgen"]["identity"]["base"].startswith("random-0-")
    rows = curves(only(tmp_path))
    assert rows[2]["norm/lora_B"] > 0, "the adapter has learned nothing"


@pytest.mark.parametrize(
    ("entry", "value", "said"),
    [("base", "another", "base=random-0-.* .there another."), ("stage", 2, r"stage=1 \(there 2\)"),
     ("data", "another", r"data=.* \(there another\)")],
)  # fmt: skip
def test_a_checkpoint_of_other_weights_is_refused_by_name(
    entry: str, value: Any, said: str, latents: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of another base, another stage, another cache."""
    with monkeypatch.context() as patch:
        stopped_at(patch, "training_step", 4, terminate)
        with pytest.raises(saving.Stopped):
            stages.run(config(tmp_path, latents))
    file = only(tmp_path) / "last.ckpt"
    content = torch.load(file, weights_only=True)
    content["fracgen"]["identity"][entry] = value
    torch.save(content, file)
    with pytest.raises(ValueError, match=f"last.ckpt belongs to another training: {said}"):
        stages.run(config(tmp_path, latents))


def test_a_damaged_checkpoint_is_refused_with_the_way_out(latents: Path, tmp_path: Path) -> None:
    run = stages.run(config(tmp_path, latents, "stages.stage1.steps=1"))[0]
    (run.folder / "run.json").unlink()
    run.checkpoint.write_bytes(run.checkpoint.read_bytes()[:1000])
    with pytest.raises(ValueError, match=r"last.ckpt cannot be read .*output.overwrite=true"):
        stages.run(config(tmp_path, latents, "stages.stage1.steps=1"))
    stages.run(config(tmp_path, latents, "stages.stage1.steps=1", "output.overwrite=true"))
    assert run.finished
