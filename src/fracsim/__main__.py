"""python -m fracsim: compose a scene, run it, print where the sample lies."""

import sys

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracsim.entry.memory import collect_rarely
from fracsim.run import job
from fracsim.scene.program import SIMULATE

# The function of an importable module, so that workers find it.
run = hydra.main(config_path=str(SIMULATE.folder), config_name=SIMULATE.primary, version_base="1.3")(job.run)
RESUME = "repeat the command to go on; finished samples are not made again"


def main() -> None:
    """Entry point; exit status 0 when every scene finished, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    collect_rarely()
    job.RESULTS.clear()
    entry.main(SIMULATE, run, RESUME)
    failed = sum(summary.failed for summary in job.RESULTS)
    if failed and sum(summary.counts.total() for summary in job.RESULTS) > 1:
        print(f"{failed} scene(s) failed", file=sys.stderr)
    if failed:
        sys.exit(entry.BAD)


if __name__ == "__main__":
    main()
