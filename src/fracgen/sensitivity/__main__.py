"""python -m fracgen.sensitivity: score true clips that were made wrong in known ways, and print a table."""

from pathlib import Path

from fracgen.config.sensitivity import SensitivityConfig
from fracsim import entry
from fracsim.scene.program import Program

SENSITIVITY: Program[SensitivityConfig] = Program(
    "fracgen.sensitivity", "sensitivity", SensitivityConfig, plugins=("metric",)
)
RESUME = "repeat the command; nothing was written"


def task(cfg: SensitivityConfig) -> None:
    """Measure, print and write; raises ValueError, OSError."""
    from fracgen.sensitivity import report, study  # here, because torch takes long to load

    found = study.run(cfg)
    print(report.markdown(found))
    for path in report.write(found, Path(cfg.output.folder).expanduser()):
        print(path)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(SENSITIVITY, task, RESUME)


if __name__ == "__main__":
    main()
