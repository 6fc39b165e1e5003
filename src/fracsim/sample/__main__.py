"""Check samples, and show them: `python -m fracsim.sample verify FOLDER...`, `... picture FOLDER FILE`."""

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from fracsim.sample import read, schema, verify
from fracsim.sample.picture import save


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; returns 1 when a sample is not as it was written, or cannot be shown."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.sample", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    checked = commands.add_parser("verify", help="compare samples with what was written, a line each")
    checked.add_argument("folder", nargs="+", help="sample, or folder of samples")
    checked.set_defaults(run=_verify)
    shown = commands.add_parser("picture", help="write a sample as GIF, WebP or PNG")
    shown.add_argument("folder", help="sample")
    shown.add_argument("file", help="picture to write, as tear.gif, tear.webp or tear.png")
    shown.add_argument("--width", type=int, default=1000, help="largest width [px]")
    shown.add_argument("--step", type=int, default=2, help="show every STEP-th frame")
    shown.set_defaults(run=_picture)
    given = parser.parse_args(arguments)
    return int(given.run(given))


def _verify(given: argparse.Namespace) -> bool:
    """Print a line a sample, and its problems."""
    failed = False
    for folder in _samples(given.folder):
        problems = verify(folder)
        print(f"{folder}: {'; '.join(problems) or 'as it was written'}")
        failed |= bool(problems)
    return failed


def _samples(folders: Sequence[str]) -> Iterator[Path]:
    """The samples named, and those in folders of samples; what else lies there, as multirun, is passed over."""
    for name in folders:
        inside = sorted(p.parent for p in Path(name).expanduser().glob(f"*/{schema.META}"))
        if inside and not (Path(name) / schema.META).is_file():
            yield from inside
        elif len(folders) == 1 or (Path(name) / schema.META).is_file():
            yield Path(name)


def _picture(given: argparse.Namespace) -> bool:
    """Write a picture and say where it lies."""
    try:
        path = save(read(given.folder), given.file, given.width, given.step)
    except (ValueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return True
    print(f"{path} ({path.stat().st_size / 1e6:.2g} MB)")
    return False


if __name__ == "__main__":
    sys.exit(main())
