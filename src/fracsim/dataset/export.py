"""Copy a data set into another format.

    python -m fracsim.dataset export DIR --to webdataset OUT    tar shards for webdataset and datasets
    python -m fracsim.dataset export DIR --to pack OUT          blosc2 chunks for fast reading, smaller if wanted

The copy leaves out suspect clips. What is in OUT already stays, so that the same command continues one that was
interrupted. With --verify nothing is written: OUT is hashed again and compared with DIR.
"""

import argparse
from pathlib import Path
from typing import Any

from fracsim.dataset import pack, webdataset_shards
from fracsim.dataset.choice import Summary
from fracsim.dataset.command import command
from fracsim.dataset.progress import shown
from fracsim.dataset.reader import Clips, open


def add(subparsers: Any) -> None:
    """The command `export`."""
    parser = command(subparsers, "export", "copy into tar shards, or for fast reading", __doc__, run)
    parser.add_argument("--to", required=True, choices=("webdataset", "pack"), help="format of the copy")
    parser.add_argument("out", metavar="OUT", type=Path, help="folder of the copy")
    parser.add_argument("--only", type=_names, default=(), metavar="A,B", help="of rgb, alpha, tracks and the maps")
    parser.add_argument("--shard-bytes", type=_bytes, default=webdataset_shards.GIGABYTE, metavar="N",
                        help="most bytes a shard (1e9)")  # fmt: skip
    parser.add_argument("--size", type=int, metavar="PX", help="width of the pictures of a packed copy [px]")
    parser.add_argument("--processes", type=int, default=1, metavar="N", help="that make a packed copy (1)")
    parser.add_argument("--verify", action="store_true", help="check OUT and write nothing; status 1 when it is wrong")


def run(arguments: argparse.Namespace) -> int:
    """Write or verify the copy and say what came of it; returns 1 when something is wrong."""
    out: Path = arguments.out.expanduser()
    clips = open(arguments.folder)
    if out.absolute() == clips.folder:
        raise ValueError(f"OUT={out} is the data set itself: give another folder.")
    if arguments.verify:
        check = webdataset_shards.verify if arguments.to == "webdataset" else pack.verify
        problems = check(clips, out, shown)
        print("\n".join(problems) or "all as it was written")
        return int(bool(problems))
    try:
        done = _export(clips, out, arguments)
    except OSError as error:
        raise OSError(f"OUT={out} cannot be written to ({error}). What was finished there stays: free some space or "
                      "give another folder, then repeat the command.") from None  # fmt: skip
    what, megabytes = "shards" if arguments.to == "webdataset" else "clips", done.bytes / 1e6
    print(f"{len(clips)} clips in {out}, {megabytes:,.1f} MB: {done.made} {what} written, {done.kept} were there")
    return 0


def _export(clips: Clips, out: Path, arguments: argparse.Namespace) -> Summary:
    if arguments.to == "pack":
        return pack.pack(clips, out, arguments.only, arguments.size, arguments.processes, shown)
    if arguments.size is not None:
        raise ValueError("--size is for --to pack: shards hold the videos as they are.")
    return webdataset_shards.export(clips, out, arguments.only, arguments.shard_bytes, shown)


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _bytes(text: str) -> int:
    try:
        return int(float(text))
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(f"{text} is no number of bytes, as 1e9") from None
