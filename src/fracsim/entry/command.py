"""From `python -m PROGRAM ARGUMENTS` to an exit status, with every error explained in one line."""

import os
import sys
from collections.abc import Callable, Sequence
from typing import Any

# Let Hydra's errors arrive in main(), which explains them.
os.environ.setdefault("HYDRA_FULL_ERROR", "1")

from fracsim.entry.interrupt import Interrupt
from fracsim.scene.program import Program
from fracsim.scene.quoting import quoted

BAD, INTERRUPTED = 2, 130
"""Exit statuses."""


def complain(message: str) -> None:
    """Print one clear error."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr, flush=True)


def main(program: Program[Any], run: Callable[[], Any], resume: str) -> None:
    """Run a program; exit status 2 after an error, 130 after Ctrl-C or SIGTERM.

    `run` is the function that hydra.main has made of the program's task; `resume` says what to do after an
    interruption. `-c job` prints the resolved configuration.
    """
    from hydra.errors import HydraException

    multirun = [a for a in sys.argv[1:] if a in ("-m", "--multirun")]
    rest = quoted([a for a in sys.argv[1:] if a not in multirun])
    overrides = [a for a in rest if "=" in a]
    sys.argv[1:] = multirun + rest  # Hydra does not look for it between overrides
    try:
        with Interrupt():
            if [a for a in rest if a not in overrides] in (["-c", "job"], ["--cfg", "job"]) and not multirun:
                _show(program, overrides)
            else:
                program.register(with_help=bool({"-h", "--help"} & set(rest)))
                run()
    except (HydraException, ValueError) as error:
        complain(program.explain(error, overrides))
        sys.exit(BAD)
    except KeyboardInterrupt:
        print(f"interrupted: {resume}", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader has seen enough, as in `--help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        complain(f"{error}: free some space or set output.folder to a folder you may write to, then repeat the command")
        sys.exit(BAD)


def _show(program: Program[Any], overrides: Sequence[str]) -> None:
    """Print the resolved configuration as YAML; Hydra itself would show a draw instead of the drawn values.

    Raises ValueError when there is none.
    """
    from omegaconf import OmegaConf

    print(OmegaConf.to_yaml(program.compose(*overrides)), end="")
