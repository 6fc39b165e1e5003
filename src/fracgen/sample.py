"""python -m fracgen.sample: sample clips from a trained network, print where they lie."""

from typing import Any

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracgen.config.sample import SampleConfig
from fracsim.scene.program import Program

SAMPLE: Program[SampleConfig] = Program("fracgen.sample", "sample", SampleConfig)
RESUME = "repeat the command to go on; samples that are there are not made again"


def task(cfg: Any) -> None:
    """Sample as a composed configuration says; raises ValueError, OSError."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    overrides: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
    config = SAMPLE.resolve(cfg, overrides)
    from fracgen.sampling import job  # here, because torch takes long to load

    for folder in job.run(config):
        print(folder)


run = hydra.main(config_path=str(SAMPLE.folder), config_name=SAMPLE.primary, version_base="1.3")(task)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.main(SAMPLE, run, RESUME)


if __name__ == "__main__":
    main()
