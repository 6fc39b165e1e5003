"""What was observed, on disk: a line a clip and metric, so that an evaluation that was interrupted goes on.

A line that a killed process has not finished is not read. The key of a line names clips, settings and code: what
belongs to others is never taken for it.
"""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from fracgen.config.evaluate import EvaluateConfig
from fracgen.data.pictures import NORMALISATION
from fracgen.evaluation.coded import vae_of
from fracgen.evaluation.pairing import Couple
from fracsim.records import Array

FILE = "observations.jsonl"
VERSION = 1
"""Version of the rules by which clips on disk become pairs; another one observes anew."""
RULES = ("alignment", "frame_select", "fps", "resize", "percentile")
"""Fields of the configuration that shape a pair."""


class Journal:
    """The observations in a folder."""

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        """Read what is there, or forget it (`fresh`)."""
        self.path = folder / FILE
        folder.mkdir(parents=True, exist_ok=True)
        self._known: dict[tuple[str, str], dict[str, Array]] = {}
        if fresh:
            self.path.unlink(missing_ok=True)
        if self.path.is_file():
            self._read()

    def _read(self) -> None:
        text = self.path.read_bytes()
        for line in text.splitlines():
            try:
                entry = json.loads(line)
                values = {name: np.array(value, np.float64) for name, value in entry["values"].items()}
                self._known[entry["pair"], entry["metric"]] = values
            except (ValueError, KeyError, TypeError):
                continue
        if text and not text.endswith(b"\n"):
            self._append(b"\n")

    def get(self, pair: str, metric: str) -> dict[str, Array] | None:
        """What a metric observed of a pair, arrays of any shape by name; None when it did not."""
        return self._known.get((pair, metric))

    def add(self, pair: str, metric: str, values: Mapping[str, Any], clip: str) -> None:
        """Write an observation; `clip` is for people."""
        known = {name: np.asarray(value, np.float64) for name, value in values.items()}
        entry = {"clip": clip, "pair": pair, "metric": metric, "values": {n: v.tolist() for n, v in known.items()}}
        self._append(json.dumps(entry).encode() + b"\n")
        self._known[pair, metric] = known

    def _append(self, data: bytes) -> None:
        """Write at the end in one call, so that lines of two processes do not mix."""
        target = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        try:
            os.write(target, data)
        finally:
            os.close(target)


def pair_key(couple: Couple, cfg: EvaluateConfig) -> str:
    """What the observations of a couple rest on beside metrics, as a hash of 16 hex digits.

    Raises ValueError where the weights of a VAE that is needed are missing.
    """
    rules = {name: asdict(cfg)[name] for name in RULES}
    clips = [source.sha256 if source else "" for source in (couple.pred, couple.gt, couple.like)]
    vae = vae_of(cfg.vae).identity if couple.coded else ""
    text = repr(
        (VERSION, NORMALISATION, clips, couple.frozen, vae, sorted(rules.items()), sorted(couple.groups.items()))
    )
    return hashlib.sha256(text.encode()).hexdigest()[:16]
