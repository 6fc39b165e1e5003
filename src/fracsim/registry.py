"""Turns names of a configuration into modules: one file for each law, map and object."""

from difflib import get_close_matches
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from types import ModuleType


def names(package: str) -> tuple[str, ...]:
    """Names of the modules of a package such as `fracsim.damage`, sorted. Imports neither the package nor a module.

    Raises ModuleNotFoundError for an unknown package.
    """
    spec = find_spec(package)
    if spec is None:
        raise ModuleNotFoundError(f"No package named {package!r}")
    return tuple(sorted(m.name for m in iter_modules(spec.submodule_search_locations) if not m.name.startswith("_")))


def check(package: str, name: str, field: str) -> None:
    """Raise ValueError, with `field` and the known names, if `package` has no module `name`."""
    known = names(package)
    if name not in known:
        near = get_close_matches(name, known, n=1)
        way_out = f" Did you mean {near[0]}?" if near else ""
        raise ValueError(f"{field}={name} is not known: choose one of {', '.join(known)}.{way_out}")


def load(package: str, name: str, field: str) -> ModuleType:
    """The module `name` of `package`. Raises ValueError, with `field` and the known names, if there is none."""
    check(package, name, field)
    return import_module(f"{package}.{name}")
