"""python -m fracgen.evaluate: score clips, write the results, print a table and where they lie."""

import sys

from fracgen.config.evaluate import EvaluateConfig
from fracsim import entry
from fracsim.scene.program import Program

EVALUATE: Program[EvaluateConfig] = Program("fracgen.evaluate", "evaluate", EvaluateConfig, plugins=("metric",))
RESUME = "repeat the command to go on; clips that were observed are not observed again"


def task(config: EvaluateConfig) -> None:
    """Evaluate as a configuration says; exit status 2 for clips that cannot be scored where strict=true.

    Raises ValueError, OSError.
    """
    from fracgen.evaluation import job  # here, because torch takes long to load

    done = job.run(config)
    print(done.table)
    for line in done.told:
        print(line, file=sys.stderr)
    print(done.folder)
    if not done.document["metrics"]:
        entry.complain(f"nothing could be scored; {done.folder}/metrics.json names each clip and the reason.")
        sys.exit(entry.BAD)
    if config.strict and done.faults:
        entry.complain(f"strict=true: {len(done.faults)} clip(s) could not be scored; {done.folder}/metrics.json names "
                       "them.")  # fmt: skip
        sys.exit(entry.BAD)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(EVALUATE, task, RESUME)


if __name__ == "__main__":
    main()
