"""`python -m fracgen.sample`: what it calls, what it repeats, how it goes on after an interruption, what it prints."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from fracgen import sample as command
from fracgen.config.model import Vae
from fracgen.config.sample import Generated, SampleConfig, Sampler
from fracgen.sampling import generate, networks
from fracsim.sample import read, verify
from tests.command import environment
from tests.gen import sampling_run
from tests.gen.sampling_run import batch_fixture, place_fixture, sampled, single_fixture  # noqa: F401


def test_equal_commands_give_equal_samples_bit_for_bit_and_other_seeds_others(
    single: SampleConfig, tmp_path: Path
) -> None:
    (first,) = sampled(single)
    (again,) = sampled(replace(single, output=Generated(folder=str(tmp_path / "again"))))
    (other,) = sampled(replace(single, seed=1))
    assert again.path.name == first.path.name != other.path.name
    for name in ("rgb", *first.maps):
        assert np.array_equal(first.stored(name), again.stored(name))
    assert not np.array_equal(first.rgb, other.rgb)


def test_a_batch_of_two_gives_what_two_single_ones_give(batch: SampleConfig, tmp_path: Path) -> None:
    """Matrix products of two clips may sum in another order: 1e-5 of values near 1, at most one step of 255."""
    alone = sampled(batch)
    together = sampled(replace(batch, batch=2, output=Generated(folder=str(tmp_path / "two"))))
    assert [s.path.name for s in alone] == [s.path.name for s in together]
    assert len(alone) == 2
    for one, other in zip(alone, together, strict=True):
        assert np.abs(one.rgb.astype(int) - other.rgb).max() <= 1
        for name in one.maps:
            assert np.allclose(one.maps[name], other.maps[name], atol=1e-4)
    assert not np.array_equal(alone[0].rgb, alone[1].rgb)


class Counted:
    """Counts calls of networks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.velocities, self.decoded = 0, 0
        velocity, decode = generate.velocity, networks.FrozenVae.decode

        def counted_velocity(*arguments: Any) -> torch.Tensor:
            self.velocities += 1
            return velocity(*arguments)

        def counted_decode(vae: Any, latent: torch.Tensor) -> torch.Tensor:
            self.decoded += len(latent)
            return decode(vae, latent)

        monkeypatch.setattr(generate, "velocity", counted_velocity)
        monkeypatch.setattr(networks.FrozenVae, "decode", counted_decode)


@pytest.mark.parametrize(("guidance", "passes", "calls"), [(1.0, "sequential", 3), (2.0, "sequential", 6),
                                                           (2.0, "batched", 3)])  # fmt: skip
def test_the_network_is_called_once_a_step_and_twice_with_guidance(
    guidance: float, passes: str, calls: int, single: SampleConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted = Counted(monkeypatch)
    sampled(replace(single, sampler=Sampler(solver="unipc", steps=3, guidance=guidance, passes=passes)))
    assert counted.velocities == calls


def test_only_the_maps_that_are_asked_for_are_decoded(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = Counted(monkeypatch)
    (made,) = sampled(replace(single, maps=["damage"]))
    assert list(made.maps) == ["damage"]
    assert counted.decoded == 2
    (bare,) = sampled(replace(single, maps=[]))
    assert list(bare.maps) == []
    assert counted.decoded == 3


def test_a_sample_that_is_there_is_not_made_again_unless_asked_for(
    batch: SampleConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that was interrupted after its first clip goes on with the second."""
    counted = Counted(monkeypatch)
    (first,) = sampled(replace(batch, limit=1))
    assert counted.velocities == 2
    both = sampled(batch)
    assert counted.velocities == 4
    assert both[0].path == first.path
    assert len({s.path for s in both}) == 2
    sampled(batch)
    assert counted.velocities == 4
    sampled(replace(batch, output=Generated(folder=batch.output.folder, overwrite=True)))
    assert counted.velocities == 8


@pytest.fixture
def line(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run the command line in this process; gives its exit status."""

    def call(*arguments: str) -> int:
        vae: Vae = sampling_run.VAE
        sizes = [
            "vae.kind=wan",
            f"vae.base_dim={vae.base_dim}",
            "vae.dim_mult=[1,1,1,1]",
            f"vae.res_blocks={vae.res_blocks}",
        ]
        monkeypatch.setattr(sys, "argv", ["sample", f"run={place / 'stage3-b'}", "encoders=tiny", "vae=tiny", *sizes,
                                          f"output.folder={tmp_path}", *arguments])  # fmt: skip
        try:
            command.main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    return call


def test_the_command_line_samples_and_prints_where(
    line: Callable[..., int], place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = (f"image={place / 'tart.png'}", f"condition={place / 'pull.json'}", "sampler=preview", "sampler.steps=2")
    assert line(*asked, "maps=[damage]") == 0
    folder = Path(capsys.readouterr().out.strip())
    assert folder.parent == tmp_path
    assert read(folder).meta["content"]["sampler"]["solver"] == "unipc"
    assert line(*asked, "maps=[heat]") == 2
    assert "maps=[heat] is not allowed: it must be one of flow, strain" in capsys.readouterr().err
    assert line(*asked, "sampler.solver=heun") == 2
    assert "sampler.solver=heun is not known: choose one of euler, unipc" in capsys.readouterr().err
    assert line(*asked, "smapler.steps=2") == 2
    assert "smapler" in capsys.readouterr().err


def test_a_command_that_is_interrupted_says_how_to_go_on_and_goes_on(
    line: Callable[..., int], place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Ctrl-C in the first step of the second clip: the first one is whole, and nothing else is there."""
    asked = (f"data={place / 'data'}", "sampler.steps=2", "maps=[]")
    velocity, calls = generate.velocity, iter(range(100))

    def interrupted(*arguments: Any) -> torch.Tensor:
        if next(calls) == 2:
            raise KeyboardInterrupt
        return velocity(*arguments)

    monkeypatch.setattr(generate, "velocity", interrupted)
    assert line(*asked) == 130
    assert "repeat the command to go on" in capsys.readouterr().err
    (first,) = tmp_path.glob("*")
    assert verify(first) == []
    assert line(*asked) == 0
    assert next(calls) == 2 + 1 + 2  # the two steps of the second clip only
    assert len(list(tmp_path.glob("*"))) == 2


def test_the_presets_are_what_they_are_called() -> None:
    found = {name: command.SAMPLE.compose(f"sampler={name}").sampler for name in command.SAMPLE.groups["sampler"]}
    assert {name: (s.solver, s.steps) for name, s in found.items()} == {
        "preview": ("unipc", 10), "default": ("unipc", 20), "reference": ("unipc", 200)}  # fmt: skip
    assert found["default"] == Sampler()
    assert found["reference"].dtype == "float32"
    assert all((s.shift, s.guidance) == (0, 1) for s in found.values())


def test_help_and_errors_need_no_torch() -> None:
    code = "import sys; from fracgen import sample; sample.SAMPLE.compose('seed=3'); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr
