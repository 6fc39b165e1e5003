"""The page for tests: commands that take no time, a cut-out by brightness, a client that a browser's page would be."""

import json
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

from fracgen.annotation.app import create
from fracgen.annotation.commands import Task
from fracgen.annotation.place import Settings
from fracsim.photo import Photo
from fracsim.records import Array
from fracsim.scene.condition import Condition

BASE = "http://127.0.0.1:8000"
QUICK = """
import pathlib, shutil, sys, time
folder, film, steps, pause = pathlib.Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
for k in range(steps):
    print(f"frame {k + 1} of {steps}, 1 s left", file=sys.stderr, flush=True)
    time.sleep(pause)
(folder / "0123456789ab").mkdir(parents=True)
print("break             at frame 2 (t = 0.02 s)")
shutil.copy(film, folder / "0123456789ab" / "strip.mp4")
print(folder / "0123456789ab")
"""
"""A command that looks like a simulation: signs of life, then a sample with a film."""


def command(film: Path, steps: int = 3, pause: float = 0.0) -> Any:
    """Makes the command of a task: `steps` frames, `pause` seconds each."""

    def made(task: Task) -> list[str]:
        assert task.picture.is_file()
        assert task.mask.is_file()
        assert json.loads(task.condition.read_text())["category"] == task.category
        return [sys.executable, "-c", QUICK, str(task.output), str(film), str(steps), str(pause)]

    return made


def saying(code: str) -> Any:
    """A command that runs some Python."""
    return lambda task: [sys.executable, "-c", code]


def dark(photo: Photo) -> Array:
    """What is brown in a photo, (H, W) bool; raises ValueError when nothing is."""
    mask: Array = photo.rgb[..., 0].astype(int) - photo.rgb[..., 2] > 40
    if not mask.any():
        raise ValueError("nothing is brown: paint it")
    return np.asarray(mask)


class Tab:
    """One tab: its requests carry the origin of the page, its paths its token."""

    def __init__(self, client: TestClient) -> None:
        self.client = client
        self.token = client.post("/session").json()["token"]

    def request(self, method: str, path: str, **options: Any) -> Any:
        return self.client.request(method, f"/session/{self.token}/{path}", **options)

    def get(self, path: str, **query: Any) -> Any:
        return self.request("GET", path, params=query or None)

    def upload(self, file: Path) -> Any:
        return self.request("PUT", "picture", content=file.read_bytes())

    def start(self, kind: str = "simulate", **changes: Any) -> Any:
        content = json.dumps({**asdict(Condition()), **changes})
        return self.request("POST", f"jobs/{kind}", content=content, params={"fit": "fit"})

    def jobs(self) -> Any:
        return self.get("jobs").json()

    def wait(self, *states: str, job: int = -1, seconds: float = 30.0) -> Any:
        """The job once it has one of the states, within far more seconds than it takes."""
        for _ in range(int(20 * seconds)):
            found = self.jobs()[job]
            if found["state"] in states:
                return found
            time.sleep(0.05)
        raise AssertionError(found)


@contextmanager
def served(**settings: Any) -> Iterator[TestClient]:
    """A client of a page with these settings, as a page of this very server would be one."""
    app = create(Settings(**{"cut": dark, **settings}))
    with TestClient(app, base_url=BASE, headers={"origin": BASE}) as client:
        yield client


def text(values: Sequence[float] | None = None, **changes: Any) -> str:
    """A condition as JSON."""
    return json.dumps({**asdict(Condition()), **({"grips": list(values)} if values else {}), **changes})
