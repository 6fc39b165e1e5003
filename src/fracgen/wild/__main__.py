"""`python -m fracgen.wild FOLDER`: pull the objects in a folder of photos, by simulator and generator, onto one sheet.

A photo NAME.jpg is pulled as NAME.json says, a condition file as the annotation page saves it, and cut out as
NAME.mask.png shows; without these along image right, and by its colours. FIELD=VALUE goes to `python -m fracsim`. What
was made before is not made again.
"""

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from fracgen.wild import roads
from fracgen.wild.photos import PRESETS, Pulled, found, pulled
from fracgen.wild.sheet import Row, sheet
from fracsim.entry import BAD, INTERRUPTED, Interrupt, complain
from fracsim.sample import Sample


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options; what is neither an option nor FIELD=VALUE is an error."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.wild", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="photos: PNG, JPEG, WebP and others")
    parser.add_argument("overrides", nargs="*", metavar="FIELD=VALUE", help="for the simulation, as quality=preview")
    parser.add_argument("--out", type=Path, default=Path("outputs/wild"), metavar="FOLDER",
                        help="for clips and sheet.png (outputs/wild)")  # fmt: skip
    parser.add_argument("--preset", choices=sorted(PRESETS), default="bread",
                        help="material and thresholds of photos without a condition file (bread)")  # fmt: skip
    parser.add_argument("--run", type=Path, metavar="FOLDER", help="a training: generate the clips too")
    parser.add_argument("--generator", default="", metavar="OVERRIDES",
                        help="for `python -m fracgen.sample`, as 'vae=tiny encoders=tiny'")  # fmt: skip
    options = parser.parse_intermixed_args(argv)  # FIELD=VALUE also behind options
    for override in options.overrides:
        if "=" not in override:
            parser.error(f"{override} is no FIELD=VALUE for the simulation, as quality=preview.")
    if options.generator and options.run is None:
        parser.error(f"--generator {options.generator} has no effect without --run FOLDER.")
    return options


def main(argv: Sequence[str] | None = None) -> int:
    """Run all photos and write the sheet; exit status 0, 2 when one failed, 130 after Ctrl-C or SIGTERM."""
    options = arguments(argv)
    try:
        with Interrupt():
            return _all(options)
    except (ValueError, OSError) as error:
        complain(str(error))
        return BAD
    except KeyboardInterrupt:
        print("interrupted: repeat the command to go on; finished clips are not made again", file=sys.stderr)
        return INTERRUPTED


def _all(options: argparse.Namespace) -> int:
    """Run all photos and write the sheet; the exit status."""
    photos, rows, failed = found(options.folder), [], 0
    for number, photo in enumerate(photos, 1):
        begin = time.monotonic()
        row, errors = _one(photo, options)
        failed += bool(errors)
        for error in errors:
            complain(f"{photo.name}: {error}")
        rows += [row] if row.simulated or row.generated else []
        print(f"{number}/{len(photos)} {photo.name}: {time.monotonic() - begin:.0f} s", flush=True)
    if rows:
        print(sheet(rows, options.out / "sheet.png"))
    if failed:
        print(f"{failed} of {len(photos)} photos failed", file=sys.stderr)
    return BAD if failed else 0


def _one(photo: Path, options: argparse.Namespace) -> tuple[Row, list[str]]:
    """The clips of one photo, and what went wrong."""
    errors: list[str] = []
    simulated: Sample | None = None
    generated: Sample | None = None
    try:
        one: Pulled = pulled(photo, options.out / "conditions", options.preset)
    except ValueError as error:
        return Row(photo, None, None), [str(error)]
    try:
        simulated = roads.simulate(one, options.out / "simulated", options.overrides)
    except ValueError as error:
        errors.append(str(error))
    if options.run is not None:
        try:
            generated = roads.generate(one, options.run, options.out / "generated", shlex.split(options.generator))
        except ValueError as error:
            errors.append(str(error))
    return Row(photo, simulated, generated), errors


if __name__ == "__main__":
    sys.exit(main())
