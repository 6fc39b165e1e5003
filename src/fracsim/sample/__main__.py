"""`python -m fracsim.sample verify FOLDER...`: check samples against what was written."""

import argparse
import sys
from collections.abc import Sequence

from fracsim.sample import verify


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line a sample, and its problems; returns 1 when there are any."""
    parser = argparse.ArgumentParser(prog="python -m fracsim.sample", description=__doc__)
    parser.add_argument("action", choices=["verify"])
    parser.add_argument("folder", nargs="+", help="sample folder")
    failed = False
    for folder in parser.parse_args(arguments).folder:
        problems = verify(folder)
        print(f"{folder}: {'; '.join(problems) or 'as it was written'}")
        failed |= bool(problems)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
