"""python -m fracgen.export: write what a training has made for other programs, print where it lies."""

from fracgen.config.export import ExportConfig
from fracsim import entry
from fracsim.scene.program import Program

EXPORT: Program[ExportConfig] = Program("fracgen.export", "export", ExportConfig)
RESUME = "repeat the command; nothing half-written is left"


def task(config: ExportConfig) -> None:
    """Export as a configuration says; raises ValueError, OSError."""
    from fracgen.model import export  # here, because torch takes long to load

    print(export.export(config))


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(EXPORT, task, RESUME)


if __name__ == "__main__":
    main()
