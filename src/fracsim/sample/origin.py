"""Which sources have shaped a simulated sample, and whether the program would make it in the same way now."""

from collections.abc import Iterator, Mapping
from typing import Any

from fracsim import registry
from fracsim.sample.identity import FRACSIM, digest, modules
from fracsim.scene.vocab import Scene
from fracsim.version import __version__


def sources(scene: Scene) -> dict[str, str]:
    """First 12 hex digits of the sha256 of each law, damage law and map of a scene, by file.

    Raises ValueError for an unknown one.
    """
    return dict(_sources(scene))


def _sources(scene: Scene) -> Iterator[tuple[str, str]]:
    for package, field, name in modules(scene):
        if package in registry.OPEN:
            file = registry.source(package, name, field)
            yield f"{package.rpartition('.')[2]}/{file.name}", digest(file)[:12]


def changes(scene: Scene, meta: Mapping[str, Any]) -> str:
    """How a sample of a scene differs from one that would be made now, as a sentence; "" when nothing is known of it.

    `meta` is its meta.json. Samples without sources were made before they were kept.
    """
    then, now = meta.get("sources"), sources(scene)
    if then is None:
        return ""
    edited = [name.rpartition("/")[2] for name in now if then.get(name) != now[name]]
    version = meta["provenance"].get(FRACSIM)
    if not edited and version == __version__:
        return ""
    with_another = f" with another {', '.join(edited)}" if edited else ""
    return f"made by fracsim {version}{with_another}: output.overwrite=true makes it again"
