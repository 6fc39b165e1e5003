"""Devices that a training can be planned for."""

import os
import time
from dataclasses import dataclass

GIB = 2**30
"""Bytes."""


@dataclass(frozen=True)
class Device:
    """What a plan needs to know of a device."""

    name: str
    memory: int
    """Bytes that a process can allocate."""
    flops: float
    """Operations a second that attention and large products in bfloat16 keep up; a plan's hours rest on it."""
    reserve: int
    """Bytes that tensors do not get: context and libraries of the device, workspaces of kernels."""


SHEETS = {
    "h100": Device("H100 80 GB", int(79.1 * GIB), 400e12, int(1.5 * GIB)),
    "a100": Device("A100 80 GB", int(79.1 * GIB), 170e12, int(1.5 * GIB)),
    "4090": Device("RTX 4090 24 GB", int(23.5 * GIB), 90e12, int(1.0 * GIB)),
}
"""Memory as the driver reports it. Speed: an assumption of 40 % (H100) and 55 % (A100, 4090) of the 989, 312 and 165
TFLOP/s of their data sheets (dense, bfloat16, summed in float32)."""
DEVICES = (*SHEETS, "cpu")


def device(name: str, memory: float = 0, tflops: float = 0) -> Device:
    """The device called `name`, one of DEVICES; `memory` [GiB] and `tflops` [TFLOP/s] replace its own unless 0."""
    own = SHEETS[name] if name in SHEETS else _cpu(measure=not tflops)
    return Device(own.name, int(memory * GIB) or own.memory, tflops * 1e12 or own.flops, own.reserve)


def of_bytes(memory: int) -> Device:
    """A device of which only the memory is known."""
    return Device("this device", memory, SHEETS["h100"].flops, int(1.5 * GIB))


def _cpu(measure: bool) -> Device:
    """This machine: its memory, and half the speed of one large product, which is measured if asked for."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return Device("CPU", memory, 0.5 * product_speed() if measure else 0.0, int(0.5 * GIB))


def product_speed(size: int = 1024, repeats: int = 3) -> float:
    """Operations a second of a product of two square float32 matrices on the CPU, the best of some repeats."""
    import torch

    left, right = torch.ones(size, size), torch.ones(size, size)
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        left @ right
        times.append(time.perf_counter() - begin)
    return 2 * size**3 / min(times)
