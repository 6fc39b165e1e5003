"""Time of a training step: modes of checkpointing, precision, back-ends of attention, share of the machine's peak."""

import time
from collections.abc import Callable, Iterator
from statistics import median as middle

import torch

from fracgen.bench import cases
from fracgen.bench.record import Row, median
from fracgen.memory import attention
from fracgen.memory.flops import flops
from fracgen.memory.size import Size

GIGA = 1e9
PRECISIONS = {"32-true": torch.float32, "bf16-mixed": torch.bfloat16}


def rows(quick: bool = False) -> Iterator[Row]:
    """All figures; `quick` takes the smallest sizes."""
    device, repeats = "cuda" if torch.cuda.is_available() else "cpu", 1 if quick else 5
    peaks = {}
    for precision, dtype in PRECISIONS.items():
        peaks[precision] = peak(device, dtype, 256 if quick else 2048 if device == "cpu" else 8192, repeats)
        name = str(dtype).removeprefix("torch.")
        yield Row("largest speed of a matrix product", name, peaks[precision] / GIGA, "GFLOP/s")
    for name in ("tiny",) if quick else cases.MODELS:
        yield from steps(name, device, repeats, Size(32, 32, 5, 2) if quick else cases.SIZES[name], peaks)
    yield from backends(device, repeats, 128 if quick else 1024)


def peak(device: str, dtype: torch.dtype, size: int, repeats: int) -> float:
    """Operations a second of a product of two square matrices."""
    left, right = (torch.randn(size, size, device=device, dtype=dtype) for _ in range(2))
    return 2 * size**3 / min(seconds(lambda: left @ right, repeats))


def seconds(run: Callable[[], object], repeats: int) -> list[float]:
    """Times of repeated runs [s], after one that is not counted."""
    out = []
    for _ in range(repeats + 1):
        _wait()
        begin = time.perf_counter()
        run()
        _wait()
        out.append(time.perf_counter() - begin)
    return out[1:]


def _wait() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def steps(name: str, device: str, repeats: int, size: Size, peaks: dict[str, float]) -> Iterator[Row]:
    """A forward and backward pass of one clip in each mode and precision; variants run in turn, not one by one."""
    model = cases.MODELS[name]
    clips = cases.batch(model, size, device)
    modules = {
        (mode, precision): cases.module(cases.config(model, mode, precision), size, device)
        for precision in PRECISIONS
        for mode in cases.MODES
    }
    times: dict[tuple[str, str], list[float]] = {key: [] for key in modules}
    for _ in range(repeats):
        for key, module in modules.items():
            times[key] += seconds(lambda m=module: cases.forward_backward(m, clips), 1)  # type: ignore[misc]
    for (mode, precision), found in times.items():
        label = f"{name} ({model.train}), {size.tokens} tokens, {precision}, checkpointing={mode}"
        work = flops(model, size, mode).total
        yield median("a clip, forward and backward", label, [1e3 * t for t in found], "ms")
        yield Row("tokens", label, size.tokens / middle(found), "1/s")
        yield Row("share of the machine's peak", label, 100 * work / middle(found) / peaks[precision], "%")


def backends(device: str, repeats: int, tokens: int) -> Iterator[Row]:
    """Attention of 6 heads with 64 channels, forward and backward, by each back-end that works here."""
    query = torch.randn(1, tokens, 6, 64, device=device, dtype=torch.bfloat16, requires_grad=True)
    from diffusers.models import attention_dispatch as dispatch

    for name in attention.available(device):
        backend = dispatch.AttentionBackendName(name)

        def run(backend: dispatch.AttentionBackendName = backend) -> None:
            out = dispatch.dispatch_attention_fn(query, query, query, backend=backend)
            out.float().square().mean().backward()  # type: ignore[no-untyped-call]

        found = [1e3 * t for t in seconds(run, repeats)]
        yield median("attention back-end", f"{name}, {tokens} tokens, bfloat16", found, "ms")
