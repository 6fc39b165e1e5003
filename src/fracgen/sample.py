"""python -m fracgen.sample: sample clips from a trained network, print where they lie."""

from fracgen.config.sample import SampleConfig
from fracsim import entry
from fracsim.scene.program import Program

SAMPLE: Program[SampleConfig] = Program("fracgen.sample", "sample", SampleConfig)
RESUME = "repeat the command to go on; samples that are there are not made again"


def task(config: SampleConfig) -> None:
    """Sample as a configuration says; raises ValueError, OSError."""
    from fracgen.sampling import job  # here, because torch takes long to load

    for folder in job.run(config):
        print(folder)


def main() -> None:
    """Entry point; exit status 2 after an error, 130 after Ctrl-C or SIGTERM."""
    entry.launch(SAMPLE, task, RESUME)


if __name__ == "__main__":
    main()
