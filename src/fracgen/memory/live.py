"""Bytes of tensors that are alive, counted storage by storage: on a CPU too, and for fake tensors, which hold none."""

import weakref
from collections.abc import Iterable, Mapping, Sequence
from types import TracebackType
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_iter


class LiveBytes(TorchDispatchMode):  # type: ignore[no-untyped-call]
    """A context that counts the bytes of tensors made in it: `now` those alive, `peak` the most at any time.

    Tensors in `known` were there before and do not count. What a kernel allocates and frees within itself is not seen,
    nor is what an allocator rounds up.
    """

    def __init__(self, known: Iterable[Tensor] = ()) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self.now = self.peak = 0
        self._seen: set[int] = set()
        self._open = True
        for tensor in known:
            self._enter(tensor.untyped_storage(), counted=False)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)  # type: ignore[no-untyped-call]
        self._open = False

    def __torch_dispatch__(
        self, func: Any, types: Sequence[type], args: tuple[Any, ...] = (), kwargs: Mapping[str, Any] | None = None
    ) -> Any:
        """Call the operator and look at what it returns."""
        out = func(*args, **(kwargs or {}))
        for item in tree_iter(out):
            if isinstance(item, Tensor):
                self._enter(item.untyped_storage(), counted=True)
        return out

    def _enter(self, storage: torch.UntypedStorage, counted: bool) -> None:
        """Count a storage until it dies; one that is known already, as that of a view, is not counted again."""
        key = storage._cdata
        if key in self._seen:
            return
        self._seen.add(key)
        size = storage.nbytes() if counted else 0
        self.now += size
        self.peak = max(self.peak, self.now)
        weakref.finalize(storage, self._leave, key, size).atexit = False

    def _leave(self, key: int, size: int) -> None:
        if self._open:
            self._seen.discard(key)
            self.now -= size
