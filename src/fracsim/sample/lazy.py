"""Maps that are decoded when they are first asked for."""

from collections.abc import Callable, Iterator, Mapping, Sequence

from fracsim.records import Array


class Maps(Mapping[str, Array]):
    """Recorded maps by name, each [T, H, W, C] float32 in physical units, decoded at first use."""

    def __init__(self, names: Sequence[str], load: Callable[[str], Array]) -> None:
        self._names, self._load = tuple(names), load
        self._decoded: dict[str, Array] = {}

    def __getitem__(self, name: str) -> Array:
        if name not in self._names:
            raise KeyError(f"map {name} was not recorded; there are: {', '.join(self._names) or 'none'}")
        if name not in self._decoded:
            self._decoded[name] = self._load(name)
        return self._decoded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
