"""Names in a configuration become modules: one file a law, one file a map."""

import pkgutil
from importlib import import_module
from types import ModuleType


def names(package: str) -> tuple[str, ...]:
    """The plug-ins of a package, as `fracsim.damage`, sorted."""
    path = import_module(package).__path__
    return tuple(sorted(m.name for m in pkgutil.iter_modules(path) if not m.name.startswith("_")))


def load(package: str, name: str, field: str) -> ModuleType:
    """The module `name` of `package`; raises ValueError naming `field` and the known names otherwise."""
    known = names(package)
    if name not in known:
        raise ValueError(f"{field}={name} is not known: choose one of {', '.join(known)}.")
    return import_module(f"{package}.{name}")
