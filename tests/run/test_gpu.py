"""Where Taichi has another backend than the CPU, a scene looks the same there: `make test-gpu`."""

import sys
from pathlib import Path

import numpy as np
import pytest

from fracsim import sample
from tests.command import SMALL, fracsim_command, samples

ARCHS = ("metal",) if sys.platform == "darwin" else ("cuda", "vulkan")


@pytest.mark.gpu
@pytest.mark.parametrize("arch", ARCHS)
def test_a_torn_bar_is_the_same_on_a_gpu_as_on_the_cpu(arch: str, tmp_path: Path) -> None:
    clips = {}
    for name in ("cpu", arch):
        overrides = ("asset=bar", f"backend.arch={name}", f"output.folder={tmp_path / name}")
        done = fracsim_command(*SMALL, *overrides)
        if f"backend.arch={arch} is not" in done.stderr:
            pytest.skip(f"no {arch} here")
        assert done.returncode == 0, done.stderr
        clips[name] = sample.read(samples(tmp_path / name)[0])
    cpu, gpu = clips["cpu"], clips[arch]
    # Only the order of float32 sums differs: some 1e-7 a substep, over a hundred of them.
    assert np.abs(cpu.rgb.astype(int) - gpu.rgb).max() <= 2
    for name, values in cpu.maps.items():
        assert np.abs(values - gpu.maps[name]).max() <= 1e-3 * np.abs(values).max()
