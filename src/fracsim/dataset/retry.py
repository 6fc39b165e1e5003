"""Run the failed and the broken draws of a data set again.

    python -m fracsim.dataset retry DIR

The scenes are those of failures/*.yaml and of samples that are not as they were written. What succeeds takes the place
of the broken sample, and its file in failures/ is deleted; what fails again stays. Exit status 1 when something does.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from fracsim.dataset import folders, index, verify
from fracsim.dataset.command import command
from fracsim.dataset.progress import Progress, shown, silent
from fracsim.sample import schema
from fracsim.sample.identity import scene_id
from fracsim.scene.vocab import Scene


def retry(folder: Path | str, progress: Progress = silent) -> tuple[int, list[str]]:
    """Run failed and broken draws again; returns how many succeeded, and the name and reason of each other one.

    Raises ValueError for a folder without samples.
    """
    from fracsim.run import pipeline  # here, because it needs Taichi

    root = folders.root(folder)
    broken = [found.name for found in verify.check(root, progress=progress) if found.kind == "broken"]
    done, left = 0, []
    files = [*verify.failures(root), *(root / name / schema.SCENE for name in broken)]
    for path, scene in progress(_scenes(root, files), len(files), "running scenes"):
        if isinstance(scene, str):
            left.append(scene)
            continue
        outcome = pipeline.run(scene)
        if not outcome.finished:
            left.append(f"{path.relative_to(root)}: {outcome.reason}")
            continue
        done += 1
        if path.parent.name == verify.FAILURES:
            path.unlink()
    if done:
        index.build(root)
    return done, left


def _scenes(root: Path, files: list[Path]) -> Iterator[tuple[Path, Scene | str]]:
    """The scene of each file, to be written to `root`; or why it cannot be run."""
    for path in files:
        try:
            scene = schema.load_scene(path)
            of_sample = path.parent.name != verify.FAILURES
            if of_sample and scene_id(scene) != path.parent.name:
                raise ValueError(f"{path} has changed too: delete {path.parent} and repeat the command of its sweep.")
            yield path, replace(scene, output=replace(scene.output, folder=str(root), overwrite=of_sample))
        except ValueError as error:
            yield path, str(error)


def add(subparsers: Any) -> None:
    """The command `retry`."""
    command(subparsers, "retry", "run failed and broken draws again", __doc__, run)


def run(arguments: argparse.Namespace) -> int:
    """Print how many draws succeeded and why the others did not; returns 1 when there are others."""
    done, left = retry(arguments.folder, shown)
    for line in left:
        print(f"failed again  {line}")
    print(f"{done} succeeded, {len(left)} failed again")
    return int(bool(left))
