"""Refuses objects that cannot be simulated, before any long work, with one error that names the way out."""

import re
from pathlib import Path

import numpy as np

from fracsim.records import Array
from fracsim.scene.vocab import Asset

MESHES = (".obj", ".glb", ".gltf", ".ply", ".stl")
SPLATS = (".splat", ".spz", ".ksplat", ".sog")
MOST_BYTES = 1 << 31
"""Largest file."""
FEWEST = 8
"""Fewest particles."""
MOST_GRID = 1e8
"""Most grid points of a filling."""


def check(asset: Asset, spacing: float) -> None:
    """Raises ValueError for fields of `asset` that `fracsim.scene.vocab` cannot check alone."""
    if not spacing > 0:
        raise ValueError(f"spacing={spacing} must be > 0: it is solver.h / solver.particles_per_axis.")
    if len(asset.rotate_deg) != 3:
        raise ValueError(f"asset.rotate_deg={asset.rotate_deg} must have three angles, as [-90,0,0].")
    if asset.interior:
        colour(asset.interior)
    if asset.kind != "builtin":
        _check_file(asset)


def _check_file(asset: Asset) -> None:
    """Raises ValueError unless asset.path is a file, at most MOST_BYTES large; the name of a mesh must tell its kind.

    Files of splats are told by their content (`fracsim.asset.splat_file`).
    """
    file = Path(asset.path)
    if asset.kind == "mesh" and file.suffix.lower() not in MESHES:
        out = (
            "it holds splats: set asset.kind=ply"
            if file.suffix.lower() in SPLATS
            else "export the object to such a file"
        )
        raise ValueError(f"asset.path={asset.path} with asset.kind=mesh must end in {' or '.join(MESHES)}: {out}.")
    if asset.kind == "ply" and file.suffix.lower() in MESHES and file.suffix.lower() != ".ply":
        raise ValueError(
            f"asset.path={asset.path} with asset.kind=ply must be a file of Gaussians (.ply, .spz or .splat): for a "
            "mesh set asset.kind=mesh, Gaussians in glTF turn into a .ply by SuperSplat."
        )
    if not file.is_file():
        raise ValueError(f"asset.path={asset.path} is not a file, seen from {Path.cwd()}: correct the path.")
    if file.stat().st_size > MOST_BYTES:
        raise ValueError(
            f"asset.path={asset.path} has {file.stat().st_size / 2**30:.1f} GiB, at most {MOST_BYTES / 2**30:g} "
            "are read: decimate the mesh, or prune the Gaussians."
        )
    if asset.kind == "ply":
        from fracsim.asset import splat_file

        splats(asset, splat_file.count(asset.path))


def colour(text: str) -> tuple[float, float, float]:
    """The sRGB values in [0, 1] of '#rrggbb'; raises ValueError for anything else."""
    if not re.fullmatch(r"#[0-9a-fA-F]{6}", text):
        raise ValueError(f"asset.interior={text} is not a colour: write '#rrggbb', as '#f2e0c0', or leave it empty.")
    r, g, b = (int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b


def estimate(asset: Asset, spacing: float, volume: float, area: float, bounds: tuple[Array, Array]) -> None:
    """Raises ValueError if a solid of about `volume` [m^3], `area` [m^2] and `bounds`, (3,) and (3,) [m], is too large.

    Each spacing^2 of the surface adds half a particle to those of the volume. A slim object may have few particles but
    need a large grid to find them.
    """
    count(asset, spacing, int(volume / spacing**3 + 0.5 * area / spacing**2), "about ")
    grid = float(np.prod((bounds[1] - bounds[0]) / spacing + 7))
    if grid > MOST_GRID:
        raise ValueError(
            f"asset.size={asset.size:g} with particles {spacing:g} m apart needs a grid of {grid:.2g} points to "
            f"fill, at most {MOST_GRID:.0e} are allowed: lower asset.size or solver.cells."
        )


def splats(asset: Asset, n: int) -> None:
    """Raises ValueError if a file has more Gaussians, `n`, than there may be particles: each one becomes a particle."""
    if n > asset.max_particles:
        raise ValueError(
            f"asset.max_particles={asset.max_particles} but asset.path={asset.path} has {n} Gaussians, and each "
            f"becomes a particle, whatever solver.cells is: prune the file, as by `npx @playcanvas/splat-transform "
            f"{Path(asset.path).name} --decimate {asset.max_particles} out.ply`, or set "
            f"asset.max_particles={_round(2 * n)}."
        )


def _round(n: int) -> int:
    """`n` rounded up to one digit."""
    digit = int(10 ** (len(str(n)) - 1))
    return -(-n // digit) * digit


def count(asset: Asset, spacing: float, n: int, about: str = "") -> None:
    """Raises ValueError unless FEWEST <= n <= asset.max_particles; an estimate (`about`) may be below FEWEST."""
    if n > asset.max_particles:
        raise ValueError(
            f"asset.max_particles={asset.max_particles} but the object needs {about}{n} particles {spacing:g} m "
            f"apart: lower solver.cells or asset.size={asset.size:g}, or raise asset.max_particles."
        )
    if n < FEWEST and not about:
        raise ValueError(
            f"asset.size={asset.size:g} gives {n} particles {spacing:g} m apart, at least {FEWEST} are needed: "
            "raise asset.size or solver.cells."
        )
