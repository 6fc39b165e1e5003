"""python -m fracsim: compose a scene, run it, print where the sample lies."""

import os
import sys
from collections.abc import Sequence
from typing import Any

# Let Hydra's errors arrive in main(), which explains them.
os.environ.setdefault("HYDRA_FULL_ERROR", "1")

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import OmegaConf

from fracsim.scene.program import SIMULATE

BAD, INTERRUPTED = 2, 130
"""Exit statuses."""
FAILED: list[str] = []
"""Errors of scenes; in a multirun the others still run."""


def fail(message: str) -> None:
    """Print one clear error, and remember it."""
    FAILED.append(" ".join(message.split()))
    print(f"error: {FAILED[-1]}", file=sys.stderr)


@hydra.main(config_path=str(SIMULATE.folder), config_name=SIMULATE.primary, version_base="1.3")
def run(cfg: Any) -> None:
    """Run the scene of one composed configuration."""
    from fracsim.run import console, pipeline

    job = HydraConfig.get()
    overrides: Any = OmegaConf.to_container(job.overrides.task, resolve=False)
    if job.mode == RunMode.MULTIRUN:
        console.heading(job.job.num + 1, overrides)
    try:
        scene = SIMULATE.resolve(cfg, overrides)
    except ValueError as error:
        fail(str(error))
        return
    with console.progress(scene) as progress:
        outcome = pipeline.run(scene, progress)
    console.show(scene, outcome)
    if outcome.status == "interrupted":
        raise KeyboardInterrupt
    if outcome.status == "failed":
        fail(outcome.reason)


def show(overrides: Sequence[str]) -> None:
    """Print the resolved scene as YAML; Hydra itself would show a draw instead of the drawn values."""
    try:
        print(OmegaConf.to_yaml(SIMULATE.compose(*overrides)), end="")
    except ValueError as error:
        fail(str(error))


def main() -> None:
    """Entry point; exit status 0 when every scene finished, 2 after an error, 130 after Ctrl-C."""
    multirun = [a for a in sys.argv[1:] if a in ("-m", "--multirun")]
    rest = [a for a in sys.argv[1:] if a not in multirun]
    overrides = [a for a in rest if "=" in a]
    sys.argv[1:] = multirun + rest  # Hydra does not look for it between overrides
    FAILED.clear()
    try:
        if [a for a in rest if a not in overrides] in (["-c", "job"], ["--cfg", "job"]) and not multirun:
            show(overrides)
        else:
            SIMULATE.register(with_help=bool({"-h", "--help"} & set(rest)))
            run()
    except (HydraException, ValueError) as error:
        fail(SIMULATE.explain(error, overrides))
        sys.exit(BAD)
    except KeyboardInterrupt:
        print("interrupted: repeat the command to go on; finished samples are not made again", file=sys.stderr)
        sys.exit(INTERRUPTED)
    except BrokenPipeError:  # the reader has seen enough, as in `--help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if multirun and FAILED:
        print(f"{len(FAILED)} scene(s) failed", file=sys.stderr)
    if FAILED:
        sys.exit(BAD)


if __name__ == "__main__":
    main()
