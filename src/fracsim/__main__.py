"""python -m fracsim: compose a scene, run it, print where the sample lies."""

import os
import sys
from collections.abc import Sequence

# Let Hydra's errors arrive in main(), which explains them.
os.environ.setdefault("HYDRA_FULL_ERROR", "1")

import hydra
from hydra.errors import HydraException
from omegaconf import OmegaConf

from fracsim.run import job
from fracsim.run.interrupt import Interrupt
from fracsim.run.lines import complain
from fracsim.scene.program import SIMULATE

BAD, INTERRUPTED = 2, 130
"""Exit statuses."""

# The function of an importable module, so that workers find it.
run = hydra.main(config_path=str(SIMULATE.folder), config_name=SIMULATE.primary, version_base="1.3")(job.run)


def main() -> None:
    """Entry point; exit status 0 when every scene finished, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    multirun = [a for a in sys.argv[1:] if a in ("-m", "--multirun")]
    rest = [a for a in sys.argv[1:] if a not in multirun]
    overrides = [a for a in rest if "=" in a]
    sys.argv[1:] = multirun + rest  # Hydra does not look for it between overrides
    job.RESULTS.clear()
    try:
        with Interrupt():
            if [a for a in rest if a not in overrides] in (["-c", "job"], ["--cfg", "job"]) and not multirun:
                show(overrides)
            else:
                SIMULATE.register(with_help=bool({"-h", "--help"} & set(rest)))
                run()
    except (HydraException, ValueError) as error:
        complain(SIMULATE.explain(error, overrides))
        sys.exit(BAD)
    except KeyboardInterrupt:
        print("interrupted: repeat the command to go on; finished samples are not made again", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader has seen enough, as in `--help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        complain(f"{error}: free some space or set output.folder to a folder you may write to, then repeat the command")
        sys.exit(BAD)
    failed = sum(summary.failed for summary in job.RESULTS)
    if failed and sum(summary.counts.total() for summary in job.RESULTS) > 1:
        print(f"{failed} scene(s) failed", file=sys.stderr)
    if failed:
        sys.exit(BAD)


def show(overrides: Sequence[str]) -> None:
    """Print the resolved scene as YAML; Hydra itself would show a draw instead of the drawn values.

    Raises ValueError when there is none.
    """
    print(OmegaConf.to_yaml(SIMULATE.compose(*overrides)), end="")


if __name__ == "__main__":
    main()
