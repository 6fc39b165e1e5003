"""Files of Gaussians: the content tells the format, not the name. Formats that are not read are named."""

from pathlib import Path

from fracsim.asset import antimatter, ply, spz
from fracsim.asset.cloud import Gaussians

TURN = "turn it into a .ply, as by `npx @playcanvas/splat-transform {} out.ply`, or by Export in SuperSplat"
OTHERS = {b"PK\x03\x04": "a zip archive, as .sog files are", b"{": "a JSON file, as the meta.json of SOG or a .gltf is",
          b"glTF": "a binary glTF file: if it is a mesh, set asset.kind=mesh"}  # fmt: skip
"""What else begins with these bytes."""
LONGEST_HEADER = 1 << 16
"""Bytes of a PLY file among which its header ends."""


def read(path: str | Path) -> Gaussians:
    """The Gaussians of a .ply, compressed .ply, .spz or .splat file; raises ValueError, with asset.path, for others."""
    return {"ply": ply.read, "spz": spz.read, "splat": antimatter.read}[_format(path)](path)


def count(path: str | Path) -> int:
    """The number of Gaussians, from the header alone; raises ValueError as `read` does."""
    kind = _format(path)
    if kind != "ply":
        return spz.count(path) if kind == "spz" else antimatter.count(path)
    with Path(path).open("rb") as stream:
        header = stream.read(LONGEST_HEADER).partition(b"end_header")[0].split()
    pairs = zip(header, header[1:], header[2:], strict=False)
    return next((int(n) for a, b, n in pairs if (a, b) == (b"element", b"vertex") and n.isdigit()), 0)


def _format(path: str | Path) -> str:
    """ply, spz or splat; raises ValueError, with asset.path and what the file seems to be, for others."""
    with Path(path).open("rb") as stream:
        head = stream.read(1 << 12)
    if head[:3] == b"ply":
        return "ply"
    if spz.is_one(head):
        return "spz"
    known = next((words for start, words in OTHERS.items() if head.startswith(start)), "")
    if not known and antimatter.is_one(path):
        return "splat"
    name = Path(path).name
    seems = f"it seems to be {known}" if known else "its content is none of these"
    raise ValueError(
        f"asset.path={path} with asset.kind=ply must be a .ply (as point_cloud.ply), compressed .ply, .spz or .splat "
        f"file of Gaussians; {seems}: {TURN.format(name)}."
    )
