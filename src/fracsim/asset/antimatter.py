"""Files .splat (antimatter15 and many viewers): 32 bytes a Gaussian, without a header and without view dependence.

Position and standard deviations are float32, the colour is sRGB and opacity in bytes, the rotation w x y z in bytes.
"""

from pathlib import Path

import numpy as np

from fracsim.asset.cloud import Gaussians, Rows, gaussians
from fracsim.asset.gaussians import SH_C0

ROW = np.dtype([("means", "<f4", 3), ("deviations", "<f4", 3), ("rgba", "u1", 4), ("turn", "u1", 4)])
PROBED = 1000
"""Rows that are looked at to tell the format from noise."""


def is_one(path: str | Path) -> bool:
    """Whether the file is of this kind: whole rows whose sizes are positive and whose rotations have unit length."""
    size = Path(path).stat().st_size
    if not size or size % ROW.itemsize:
        return False
    rows = np.fromfile(path, ROW, PROBED)
    deviations = rows["deviations"]
    with np.errstate(invalid="ignore"):
        sound = np.isfinite(rows["means"]).all(axis=1) & (deviations >= 0).all(axis=1) & (deviations < 1e9).all(axis=1)
    length = np.linalg.norm((rows["turn"] - 128.0) / 128.0, axis=1)
    return bool((sound & (np.abs(length - 1) < 0.1)).mean() > 0.9)


def count(path: str | Path) -> int:
    """The number of Gaussians, from the size of the file."""
    return Path(path).stat().st_size // ROW.itemsize


def read(path: str | Path) -> Gaussians:
    """The Gaussians of the file; raises ValueError, with asset.path, if most are no numbers."""
    rows = np.fromfile(path, ROW)
    rgba = rows["rgba"] / 255.0
    return gaussians(
        path,
        Rows(
            means=rows["means"].astype(np.float64),
            deviations=rows["deviations"].astype(np.float64),
            quaternion=(rows["turn"] - 128.0) / 128.0,
            opacity=rgba[:, 3],
            sh=((rgba[:, :3] - 0.5) / SH_C0)[:, None, :],
        ),
    )
