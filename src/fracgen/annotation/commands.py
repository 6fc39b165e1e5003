"""The commands that the page starts: the simulation of a photo, and the generator."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from fracsim.photo.stage import PRESETS


@dataclass(frozen=True)
class Task:
    """What a command is about; all paths are the server's own."""

    picture: Path
    mask: Path
    condition: Path
    category: str
    fit: str
    output: Path
    """Folder that gets the sample."""


KEEP_GROUND = "cutout=none"
"""What shows the generator the whole photo."""


def simulate(task: Task) -> list[str]:
    """The preview simulation of a photo."""
    return [
        sys.executable, "-m", "fracsim", "asset=image", f"asset.path={task.picture}", f"asset.mask={task.mask}",
        f"condition={task.condition}", "camera.background=photo", "quality=preview",
        f"material={PRESETS[task.category]}", f"output.folder={task.output}",
    ]  # fmt: skip


@dataclass(frozen=True)
class Generate:
    """The generator with the checkpoint in the folder `run`, and what else its command needs."""

    run: str
    overrides: Sequence[str] = ()

    def __call__(self, task: Task) -> list[str]:
        """The command of a task: the object is alone on white, as in training, unless `overrides` has cutout=none."""
        mask = [] if KEEP_GROUND in self.overrides else [f"mask={task.mask}"]
        return [
            sys.executable, "-m", "fracgen.sample", f"run={self.run}", f"image={task.picture}", *mask,
            f"condition={task.condition}", f"fit={task.fit}", *self.overrides, f"output.folder={task.output}",
        ]  # fmt: skip
