"""The id of a sample: a hash of its producer and of the content, which is all that the producer was asked for.

Fields of a scene that equal their pinned default are left out, so that a new field does not rename older samples.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fracsim import sidefiles
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


def scene_content(scene: Scene, asset_sha256: str | None = None) -> dict[str, Any]:
    """The content of the sample of a scene: dotted field -> value, without labels and fields at their pinned default.

    asset.path counts by the content of its files: a sha256, which `asset_sha256` gives if it is known. Raises
    ValueError when the file cannot be read.
    """
    digest_of_object = asset_digest(scene) if asset_sha256 is None else asset_sha256
    content = {}
    for name, pinned in pinned_defaults(type(scene)).items():
        value = digest_of_object if name == "asset.path" else field_of(scene, name)
        if canonical(value) != canonical(pinned):
            content[name] = canonical(value)
    return content


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


def digest(path: Path) -> str:
    """sha256 of a file, in hex."""
    sha = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            sha.update(block)
    return sha.hexdigest()
