"""python -m fracgen.train: train a stage, or all three; repeat the command to go on."""

import sys
from typing import Any

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracgen.config.train import TrainConfig, check_weights
from fracsim.scene.program import Program

TRAIN: Program[TrainConfig] = Program("fracgen.train", "train", TrainConfig, optional=("experiment", "debug"))
RESUME = "repeat the command to go on from the checkpoint"


def task(config: Any) -> None:
    """Train what a composed configuration says; raises ValueError, and KeyboardInterrupt after a signal."""
    cfg = TRAIN.resolve(config)
    if not cfg.replay:
        check_weights(cfg.model)

    from fracgen.training import replay, stages
    from fracgen.training.saving import Stopped

    if cfg.replay:
        print(replay.run(cfg.replay))
        return
    try:
        stages.run(cfg)
    except Stopped:
        if stages.first_process():
            raise KeyboardInterrupt from None
        sys.exit(0)  # the first process tells


run = hydra.main(config_path=str(TRAIN.folder), config_name=TRAIN.primary, version_base="1.3")(task)


def main() -> None:
    """Entry point; exit status 0 after training, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.main(TRAIN, run, RESUME)


if __name__ == "__main__":
    main()
