"""python -m fracgen.export: write what a training has made for other programs, print where it lies."""

from typing import Any

from fracsim import entry  # before Hydra, whose errors it explains

import hydra  # isort: skip

from fracgen.config.export import ExportConfig
from fracsim.scene.program import Program

EXPORT: Program[ExportConfig] = Program("fracgen.export", "export", ExportConfig)
RESUME = "repeat the command; nothing half-written is left"


def task(cfg: Any) -> None:
    """Export as a composed configuration says; raises ValueError, OSError."""
    from hydra.core.hydra_config import HydraConfig
    from omegaconf import OmegaConf

    overrides: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
    config = EXPORT.resolve(cfg, overrides)
    from fracgen.model import export  # here, because torch takes long to load

    print(export.export(config))


run = hydra.main(config_path=str(EXPORT.folder), config_name=EXPORT.primary, version_base="1.3")(task)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.main(EXPORT, run, RESUME)


if __name__ == "__main__":
    main()
