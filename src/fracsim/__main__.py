"""python -m fracsim: compose a scene, run it, print where the sample lies."""

import os
import sys
from typing import Any

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode

from fracsim import configs

FAILED: list[str] = []
"""Errors of scenes in a multirun; the others still run."""


def fail(error: Exception) -> None:
    """Print one clear error; a multirun goes on with the next scene."""
    print(f"error: {error}", file=sys.stderr)
    if HydraConfig.get().mode != RunMode.MULTIRUN:
        sys.exit(2)
    FAILED.append(str(error))


@hydra.main(config_path=str(configs.folder()), config_name="simulate", version_base="1.3")
def run(cfg: Any) -> None:
    """Run the scene of one composed configuration."""
    from fracsim import pipeline

    try:
        pipeline.run(configs.scene(cfg))
    except (ValueError, OSError, RuntimeError) as error:
        fail(error)
    except KeyboardInterrupt:
        print("interrupted: what was rendered so far is kept and marked incomplete", file=sys.stderr)
        sys.exit(130)


def main() -> None:
    """Entry point; exit status 0 when every scene finished."""
    configs.register()
    run()
    if FAILED:
        print(f"{len(FAILED)} scene(s) failed", file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
