"""`python -m fracgen.laptop`: simulate, train, sample and score at a scale that a laptop runs in three hours.

It runs the very commands that it prints, each as a process of its own; they can be typed one by one as well. Repeat
the command to go on: what is finished is not run again.
"""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from fracgen.laptop.running import Journal, Runner, all_steps, say, typed
from fracgen.laptop.steps import Step, steps
from fracgen.laptop.study import FULL, QUICK, Study
from fracsim.entry import BAD, INTERRUPTED, Interrupt, complain

REPORT = "report"
"""The last step, which is done in this process."""
PAGE = Path("docs/laptop_results.md")
"""Where the report of a full study goes, with its pictures beside it."""


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options; an unknown step is an error."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.laptop", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    names = [*(step.name for step in steps(FULL)), REPORT]
    parser.add_argument("--only", action="append", default=[], metavar="STEP",
                        help=f"only this step, even if it is finished; repeatable: {', '.join(names)}")  # fmt: skip
    parser.add_argument("--list", action="store_true", help="print all commands and run none")
    parser.add_argument("--quick", action="store_true", help="a few clips and steps, to see whether everything runs")
    parser.add_argument("--seeds", type=int, metavar="N", help="trainings of each kind (2)")
    parser.add_argument("--steps", type=int, metavar="N", help="optimiser steps of each stage (500)")
    parser.add_argument("--folder", type=Path, metavar="FOLDER", help=f"for all that is made ({FULL.folder})")
    parser.add_argument("--page", type=Path, metavar="FILE",
                        help=f"for the report ({PAGE}; with --quick in the folder)")  # fmt: skip
    options = parser.parse_args(argv)
    for name in options.only:
        if name not in names:
            parser.error(f"--only {name} is no step: choose from {', '.join(names)}.")
    for name in ("seeds", "steps"):
        if getattr(options, name) is not None and getattr(options, name) < 1:
            parser.error(f"--{name} {getattr(options, name)} must be at least 1.")
    return options


def chosen(options: argparse.Namespace) -> Study:
    """The study that the options describe."""
    study = QUICK if options.quick else FULL
    given = {name: getattr(options, name) for name in ("seeds", "steps", "folder") if getattr(options, name)}
    return replace(study, **given)


def listed(study: Study, only: Sequence[str]) -> str:
    """All commands, by step, with the minutes that they take."""
    lines = []
    for step in wanted(study, only):
        lines += [f"# {step.name}: {step.about}; about {step.minutes:g} min", *map(typed, step.commands), ""]
    return "\n".join(lines)


def wanted(study: Study, only: Sequence[str]) -> list[Step]:
    """The steps that are asked for, in order."""
    return [step for step in steps(study) if not only or step.name in only]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study; exit status 0 when all is done, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    options = arguments(argv)
    study = chosen(options)
    if options.list:
        print(listed(study, options.only))
        return 0
    journal, runner = Journal(study.folder / "steps"), Runner(study.folder / "logs")
    try:
        with Interrupt():
            if not all_steps(wanted(study, options.only), journal, runner, again=bool(options.only)):
                return BAD
            if not options.only or REPORT in options.only:
                from fracgen.laptop import page

                default = study.folder / PAGE.name if options.quick else PAGE
                say(f"{page.write(study, options.page or default)}")
    except KeyboardInterrupt:
        print("interrupted: repeat the command to go on; what is finished is not run again", file=sys.stderr)
        return INTERRUPTED
    except (ValueError, OSError) as error:
        complain(str(error))
        return BAD
    return 0


if __name__ == "__main__":
    sys.exit(main())
