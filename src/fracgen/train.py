"""python -m fracgen.train: train a stage, or all three; repeat the command to go on."""

import sys
from typing import Any

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracgen.config.train import TrainConfig, check_weights
from fracsim.scene.program import Program

TRAIN: Program[TrainConfig] = Program("fracgen.train", "train", TrainConfig, optional=("experiment", "debug"))
RESUME = "repeat the command to go on from the checkpoint"
failed: list[str] = []
"""Errors of the jobs of this process; a multirun goes on behind one."""


def task(config: Any) -> None:
    """Train what a composed configuration says; raises KeyboardInterrupt after a signal. Errors are told."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    overrides: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
    try:
        _train(TRAIN.resolve(config, overrides))
    except ValueError as error:
        failed.append(str(error))
        entry.complain(str(error))


def _train(cfg: TrainConfig) -> None:
    """Train, or compute a step again; raises ValueError."""
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


run = hydra.main(config_path=str(TRAIN.folder), config_name=TRAIN.primary, version_base="1.3")(task)


def main() -> None:
    """Entry point; exit status 0 after training, 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.main(TRAIN, run, RESUME)
    if failed:
        sys.exit(entry.BAD)


if __name__ == "__main__":
    main()
