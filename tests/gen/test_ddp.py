"""Two processes of DistributedDataParallel train as one does with the same effective batch.

The mean of four gradients is summed in another order, so that they differ by float32 rounding, some 1e-7 of their
size. AdamW divides a gradient by its own size: where that is above its eps of 1e-8, a weight moves by the same
lr = 1e-3 to about 1e-7 of it, and elsewhere by less. 1e-5 is then ample.
"""

import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from fracgen import vae
from fracgen.train import TRAIN
from fracgen.training import stages
from tests.command import environment
from tests.gen import grey
from tests.gen.trainings import cache, config, curves, only, overrides

MORE = ("stage=3", "init_from=none", "conditioning.drop_text=0.3", "trainer.log_steps=3", "trainer.val_steps=3",
        "loss.ramp=0", "data.val_limit=4", "vae=tiny", "measure.clips=3", "logger.video_steps=1",
        "metric=[]", f"measure.outside=[{grey.__file__}]")  # fmt: skip


def test_two_processes_with_two_workers_each_equal_one(tmp_path: Path) -> None:
    """Stage 3 with all losses, four steps; two forward passes of each process against four of one. Of the three clips
    that are measured the second process has one; the means are over all, and the tables are equal."""
    torch.set_num_threads(1)
    latents = cache(tmp_path / "latents", about={"vae": vae.identity_of(TRAIN.compose("vae=tiny").vae)})
    one, two = tmp_path / "one", tmp_path / "two"
    command = overrides(two, latents, *MORE, "trainer.devices=2", "data.workers=2")
    done = subprocess.run([sys.executable, "-m", "fracgen.train", *command], env=environment(OMP_NUM_THREADS="1"),
                          capture_output=True, text=True, timeout=240)  # fmt: skip
    assert done.returncode == 0, done.stderr
    stages.run(config(one, latents, *MORE))
    assert only(one, 3).name == only(two, 3).name, "the number of processes is no part of the identity"
    expected, weights = (load_file(only(folder, 3) / "trained.safetensors") for folder in (one, two))
    for name, tensor in expected.items():
        torch.testing.assert_close(weights[name], tensor, rtol=0, atol=1e-5, msg=lambda m, name=name: f"{name}: {m}")
    assert any(not torch.equal(weights[name], tensor) for name, tensor in expected.items()), "only one process ran"
    rows, others = curves(only(one, 3)), curves(only(two, 3))
    assert rows.keys() == others.keys() == {3, 4}
    for step, row in rows.items():
        assert others[step] == pytest.approx(row, rel=1e-4, abs=1e-5)
        assert row["val/count/clips/grey"] == 3
    tables = [(only(folder, 3) / "videos" / "step-000003" / "clips.csv").read_text() for folder in (one, two)]
    assert [[line.split(",")[0] for line in table.splitlines()] for table in tables] == [
        ["id", "clip0002", "clip0003", "clip0006"]] * 2  # fmt: skip


def test_an_effective_batch_that_does_not_come_out_even_is_refused(tmp_path: Path) -> None:
    latents = cache(tmp_path / "latents")
    told = r"effective_batch=4 does not divide by .* = 1 x 3 = 3: set trainer.batch=2, or trainer.effective_batch=6"
    with pytest.raises(ValueError, match=told):
        stages.run(config(tmp_path, latents, "trainer.batch=3"))
    told = r"effective_batch=4 does not divide by .* = 3 x 1 = 3: use a number of devices that divides it"
    with pytest.raises(ValueError, match=told):
        stages.run(config(tmp_path, latents, "trainer.devices=3"))
