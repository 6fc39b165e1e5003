"""python -m fracgen.train: train a stage, or all three; repeat the command to go on."""

import sys

from fracgen.config.train import TrainConfig, check_weights
from fracsim import entry
from fracsim.scene.program import Program

TRAIN: Program[TrainConfig] = Program("fracgen.train", "train", TrainConfig, optional=("experiment", "debug"),
                                       plugins=("metric",))  # fmt: skip
RESUME = "repeat the command to go on from the checkpoint"


def task(cfg: TrainConfig) -> None:
    """Train, or compute a step again; raises ValueError, and KeyboardInterrupt after a signal."""
    if cfg.replay:
        from fracgen.training import replay

        print(replay.run(cfg.replay))
        return
    check_weights(cfg.model)  # before anything takes time

    from fracgen.training import stages
    from fracgen.training.saving import Stopped

    try:
        stages.run(cfg)
    except Stopped:
        if stages.first_process():
            raise KeyboardInterrupt from None
        sys.exit(0)  # the first process tells
    except SystemExit:  # what Lightning makes of a second signal
        raise KeyboardInterrupt from None


def main() -> None:
    """Entry point; exit status 0 after training, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(TRAIN, task, RESUME)


if __name__ == "__main__":
    main()
