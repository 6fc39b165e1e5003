"""The folder of a run, `stageN-<id>`, and what lies in it.

config.yaml, last.ckpt (to go on), metrics.csv, trained.safetensors (what was trained), and run.json, which is written
last: a run with it has finished.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from fracgen.config.train import TrainConfig
from fracgen.training.identity import differences

CHECKPOINT, TRAINED, METRICS, CONFIG, FINISHED = (
    "last.ckpt", "trained.safetensors", "metrics.csv", "config.yaml", "run.json",
)  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A run: its folder and stage, and what shapes its weights."""

    folder: Path
    stage: int
    content: dict[str, Any]

    @property
    def id(self) -> str:
        """Its hash."""
        return self.folder.name.partition("-")[2]

    @property
    def finished(self) -> bool:
        """Whether it came to its end."""
        return (self.folder / FINISHED).is_file()

    @property
    def checkpoint(self) -> Path:
        """Where it can go on."""
        return self.folder / CHECKPOINT

    def begin(self, cfg: TrainConfig) -> None:
        """Make the folder and write the configuration."""
        from omegaconf import OmegaConf

        self.folder.mkdir(parents=True, exist_ok=True)
        write(self.folder / CONFIG, OmegaConf.to_yaml(OmegaConf.structured(cfg)))

    def clear(self) -> None:
        """Forget all that was trained, run.json first; videos and other files stay."""
        for name in (FINISHED, CHECKPOINT, TRAINED, METRICS):
            (self.folder / name).unlink(missing_ok=True)

    def finish(self, facts: Mapping[str, Any]) -> None:
        """Mark as finished, with facts about the run."""
        write(self.folder / FINISHED, json.dumps({**facts, "identity": self.content}, indent=2) + "\n")


def write(path: Path, text: str) -> None:
    """Write a file at once: it is complete or not there."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    unfinished.write_text(text, encoding="utf-8")
    os.replace(unfinished, path)


def name(stage: int, id: str) -> str:
    """Name of the folder of a run."""
    return f"stage{stage}-{id}"


def parent_missing(wanted: Run) -> str:
    """Why the finished run of the stage before is not there, and the ways out; as an error message."""
    stage = wanted.stage + 1
    text = (f"init_from=auto: stage {stage} starts from a finished run of stage {wanted.stage}, and {wanted.folder} is "
            f"none{' yet' if wanted.folder.is_dir() else ''}. Train it with the same command and stage={wanted.stage}, "
            f"or train all with stage=all, or start from the base with init_from=none{_near(wanted)}.")  # fmt: skip
    return text


def _near(wanted: Run) -> str:
    """The finished run of the same stage that is nearest to the wanted one, and what is different in it."""
    found = []
    for file in wanted.folder.parent.glob(f"stage{wanted.stage}-*/{FINISHED}"):
        other = json.loads(file.read_text(encoding="utf-8")).get("identity", {})
        found.append((list(differences(wanted.content, other)), file.parent))
    if not found:
        return ""
    faults, folder = min(found, key=lambda entry: (len(entry[0]), str(entry[1])))
    return f", or use another one by init_from={folder}, where {', '.join(faults[:3])}"
