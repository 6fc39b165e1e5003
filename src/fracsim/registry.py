"""Turns names of a configuration into modules: one file for each law, map and object, of this package or of others.

Packages in OPEN also take modules from outside: by the path of a file, as ./curl.py, and by an entry point in the group
of their name, as `[project.entry-points."fracsim.maps"] curl = "their_package.curl"`.
"""

import hashlib
import re
import sys
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType

OPEN = (
    "fracsim.constitutive", "fracsim.damage", "fracsim.maps", "fracsim.photo.cutouts",
    "fracgen.features", "fracgen.metrics", "fracgen.trackers",
)  # fmt: skip
"""Packages that take modules from outside."""


def names(package: str) -> tuple[str, ...]:
    """Names of the modules of a package such as `fracsim.damage`, sorted, then those of entry points.

    Imports neither the package nor a module. Raises ModuleNotFoundError for an unknown package.
    """
    own = _own(package)
    return (*own, *sorted(set(_entries(package)) - set(own)))


def check(package: str, name: str, field: str) -> None:
    """Raise ValueError, with `field` and the known names, if there is no module `name` for `package`."""
    if package in OPEN and name.endswith(".py"):
        _file(name, field)
        return
    known = names(package)
    if name not in known:
        near = get_close_matches(name, known, n=1)
        way_out = f" Did you mean {near[0]}?" if near else ""
        path = ", or the path of a .py file" if package in OPEN else ""
        raise ValueError(f"{field}={name} is not known: choose one of {', '.join(known)}{path}.{way_out}")


def load(package: str, name: str, field: str) -> ModuleType:
    """The module `name` for `package`, which has what `NEEDED` of the package lists.

    Raises ValueError, with `field`, for an unknown one, one that cannot be imported, and one that lacks something.
    """
    check(package, name, field)
    if name.endswith(".py"):
        module = _from_file(_file(name, field), field)
    else:
        module = import_module(f"{package}.{name}" if name in _own(package) else _entries(package)[name])
    lacking = [wanted for wanted in getattr(import_module(package), "NEEDED", ()) if not hasattr(module, wanted)]
    if lacking:
        raise ValueError(f"{field}={name}: {module.__file__} lacks {', '.join(lacking)}; define it, as the modules of "
                         f"{package} do.")  # fmt: skip
    return module


def label(name: str) -> str:
    """What a module is called in files and pictures: its name without folder and ending."""
    return Path(name).stem if name.endswith(".py") else name


def is_outside(package: str, name: str) -> bool:
    """Whether `name` is a module from outside `package`."""
    return package in OPEN and name not in _own(package)


def source(package: str, name: str, field: str) -> Path:
    """The file of a module; raises ValueError, with `field`, if there is none."""
    check(package, name, field)
    if name.endswith(".py"):
        return _file(name, field)
    spec = find_spec(f"{package}.{name}" if name in _own(package) else _entries(package)[name])
    if spec is None or not spec.origin:
        raise ValueError(f"{field}={name}: its package is no longer installed.")
    return Path(spec.origin)


@cache
def _own(package: str) -> tuple[str, ...]:
    spec = find_spec(package)
    if spec is None:
        raise ModuleNotFoundError(f"No package named {package!r}")
    return tuple(sorted(m.name for m in iter_modules(spec.submodule_search_locations) if not m.name.startswith("_")))


@cache
def _entries(package: str) -> dict[str, str]:
    """The modules of entry points by name."""
    return {entry.name: entry.module for entry in entry_points(group=package)} if package in OPEN else {}


def _file(name: str, field: str) -> Path:
    path = Path(name).expanduser().absolute()
    if not path.is_file():
        raise ValueError(f"{field}={name} is not a file: give the path of a .py file that is there.")
    if not re.fullmatch(r"\w+", path.stem):
        raise ValueError(f"{field}={name} names no module: use letters, digits and _ before .py.")
    return path


def _from_file(path: Path, field: str) -> ModuleType:
    """The module in a file; one for each content, so that an edited file is another module."""
    name = f"fracsim_outside_{path.stem}_{hashlib.sha256(str(path).encode() + path.read_bytes()).hexdigest()[:12]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[name] = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ValueError(f"{field}={path} cannot be imported ({type(error).__name__}: {error}): mend it.") from error
    return module
