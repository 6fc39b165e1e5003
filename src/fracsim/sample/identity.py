"""The id of a sample: a hash of its producer and of the content, which is all that the producer was asked for.

Fields of a scene that equal their pinned default are left out, so that a new field does not rename older samples.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from fracsim import registry, sidefiles
from fracsim.scene.knob import describe
from fracsim.scene.vocab import LABELS, Scene

FRACSIM = "fracsim"
"""The producer of simulated samples."""
SECTIONS_LEFT_OUT = ("backend", "output")
"""Sections of a scene without influence on the sample: where it runs, where it is written."""


def sample_id(producer: str, content: Mapping[str, Any]) -> str:
    """First 12 hex digits of the sha256 of the canonical JSON of (producer, content).

    1 and 1.0 are the same number, and -0.0 and 0.0. Raises ValueError for content that JSON cannot hold.
    """
    try:
        entries = {"producer": producer, "content": canonical(content)}
        text = json.dumps(entries, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise ValueError(
            f"the content of a {producer} sample cannot be hashed ({error}): "
            "use texts, finite numbers, true, false, null, lists and mappings."
        ) from None
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def canonical(value: Any) -> Any:
    """`value` with all numbers as floats and -0.0 as 0.0; raises TypeError for what JSON has no type for."""
    if isinstance(value, Mapping):
        return {str(k): canonical(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [canonical(v) for v in value]
    return value if isinstance(value, (str, bool, type(None))) else float(value) + 0.0


def scene_id(scene: Scene) -> str:
    """The id of the sample of a scene; raises ValueError when the file of its object cannot be read."""
    return sample_id(FRACSIM, scene_content(scene))


def scene_content(scene: Scene, known: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """The content of the sample of a scene: dotted field -> value, without labels and fields at their pinned default.

    asset.path and asset.mask count by the content of their files, a law or map from outside by its name and source.
    `known`, the content of a sample, stands in for the files. Raises ValueError when a file cannot be read.
    """
    values = {name: field_of(scene, name) for name in pinned_defaults(type(scene))}
    values["asset.path"] = asset_digest(scene) if known is None else known.get("asset.path", "")
    values["asset.mask"] = mask_digest(scene) if known is None else known.get("asset.mask", "")
    for package, name, module in modules(scene):
        if registry.is_outside(package, module):
            counted = _by_source(package, name, module) if known is None else _known(known.get(name), module)
            old = values[name]
            values[name] = [counted if v == module else v for v in old] if isinstance(old, list) else counted
    pinned = {name: canonical(value) for name, value in pinned_defaults(type(scene)).items()}
    return {name: canonical(value) for name, value in values.items() if canonical(value) != pinned[name]}


def modules(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Package, field and name of every module that a scene chooses."""
    for field, _, knob in describe(type(scene)):
        if knob.package and (field != "asset.cutout" or scene.asset.kind == "image"):
            value = field_of(scene, field)
            yield from ((knob.package, field, name) for name in (value if isinstance(value, list) else [value]))


def _by_source(package: str, field: str, name: str) -> str:
    """A module from outside as `curl:<sha256 of its file>`; raises ValueError when it is not there."""
    return f"{registry.label(name)}:{digest(registry.source(package, name, field))}"


def _known(value: Any, name: str) -> str:
    """What stands for a module from outside in a field of a content, or its name if nothing does."""
    entries = value if isinstance(value, list) else [value]
    return next((e for e in entries if str(e).startswith(f"{registry.label(name)}:")), name)


def pinned_defaults(schema: type) -> dict[str, Any]:
    """Of every field of `schema` that counts, its default when it entered: dotted field -> value."""
    return {
        name: default if knob.pinned is None else knob.pinned
        for name, default, knob in describe(schema)
        if name not in LABELS and name.partition(".")[0] not in SECTIONS_LEFT_OUT
    }


def field_of(section: Any, dotted: str) -> Any:
    """The value of a field by its dotted name."""
    for name in dotted.split("."):
        section = getattr(section, name)
    return section


def asset_digest(scene: Scene) -> str:
    """sha256 of the object's files in hex, or "" for a built-in one; raises ValueError when it cannot be read.

    Of one file its own sha256; with files that it refers to, the sha256 of those of all, in the order of the file.
    """
    if scene.asset.kind == "builtin":
        return ""
    try:
        path = Path(scene.asset.path).expanduser()
        files = [file for _, file in sidefiles.named(path)]
        if not any(files):
            return digest(path)
        parts = [digest(path), *(digest(file) if file else "missing" for file in files)]
        return hashlib.sha256(" ".join(parts).encode()).hexdigest()
    except OSError as error:
        raise ValueError(
            f"asset.path={scene.asset.path} cannot be read ({error.strerror}): set asset.path to a file that can."
        ) from None


def mask_digest(scene: Scene) -> str:
    """sha256 of the mask of a photo in hex, or "" without one; raises ValueError when it cannot be read."""
    try:
        return digest(Path(scene.asset.mask)) if scene.asset.mask else ""
    except OSError as error:
        raise ValueError(f"asset.mask={scene.asset.mask} cannot be read ({error.strerror}): set asset.mask to a file "
                         "that can.") from None  # fmt: skip


def digest(path: Path) -> str:
    """sha256 of a file, in hex."""
    sha = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            sha.update(block)
    return sha.hexdigest()
