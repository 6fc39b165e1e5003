"""Trained 3D Gaussians as particles (asset.kind=ply): its Gaussians on the surface, new ones inside.

Each trained Gaussian becomes a surface particle with its covariance and colour. Standard deviations are limited to
LONGEST spacings (one and a half cells), since one particle cannot span a crack. The opaque cells, with small gaps
closed, enclose the inside. Checkpoints are often y down: asset.rotate_deg=[180,0,0] turns them.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fracsim.asset import apart, enclose, fill, gaussians, harmonics, limits, paint, place, ply, splat_file
from fracsim.asset.cloud import Gaussians
from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

LONGEST, SHORTEST = 3.0, 0.02
"""Bounds of standard deviations [particle spacings]."""
CLEAR = 0.6
"""Least distance of interior particles from trained Gaussians [particle spacings]."""
NOTED = 0.2
"""Hollow cells over those of the body from which on they are noted."""
LEAST = 0.02
"""Least volume of a particle [cells], before all are scaled to the body's volume: many Gaussians may share a cell."""


def prepare(asset: Asset, spacing: float, seed: int, frame: LatticeFrame = WORLD) -> Particles:
    """Particles, in `frame`, of the checkpoint asset.path; interior ones are `spacing` [m] apart.

    Raises ValueError if it cannot be used.
    """
    trained, notes = _opaque(splat_file.read(asset.path), asset)
    trained, left_out = _object(trained)
    trained = _placed(trained, asset, frame)
    trained, long = _bounded(trained, spacing)
    lo, hi = trained.means.min(axis=0), trained.means.max(axis=0)
    limits.estimate(asset, spacing, 0.0, 0.0, (lo, hi))
    axes = fill.lattice(lo, hi, spacing)
    body = enclose.enclose(trained, axes, spacing)
    inner = _inner(body, axes, trained.means, spacing)
    limits.count(asset, spacing, len(trained.means) + len(inner.X))
    notes = (*notes, *left_out, *_notes(long, body))
    sh = np.zeros((len(trained.means) + len(inner.X), *trained.sh.shape[1:]), np.float32)
    sh[: len(trained.sh)] = trained.sh
    sh[len(trained.sh) :, :1] = gaussians.constant_sh(_inner_colours(trained, inner, asset, spacing, seed))
    X = np.concatenate([trained.means, inner.X])
    volume = body.volumes(X, axes, LEAST) * spacing**3
    return _particles(trained, inner, volume, sh, spacing, notes)


def _opaque(trained: Gaussians, asset: Asset) -> tuple[Gaussians, tuple[str, ...]]:
    """The Gaussians of at least asset.opacity_threshold, and a note; raises ValueError if there are none."""
    keep = trained.opacity >= asset.opacity_threshold
    if not keep.any():
        raise ValueError(
            f"asset.opacity_threshold={asset.opacity_threshold:g} drops all {len(keep)} Gaussians of "
            f"asset.path={asset.path}: set it below {trained.opacity.max():.3g}, the opacity of the most opaque."
        )
    dropped = int((~keep).sum())
    note = (f"{dropped} of {len(keep)} Gaussians are less opaque than {asset.opacity_threshold:g} and were dropped.",)
    return _select(trained, keep), (*trained.notes, *(note if dropped else ()))


def _select(trained: Gaussians, keep: Array) -> Gaussians:
    """The Gaussians with `keep`, (N,) bool."""
    return Gaussians(trained.means[keep], trained.covariance[keep], trained.opacity[keep], trained.sh[keep])


def _object(trained: Gaussians) -> tuple[Gaussians, tuple[str, ...]]:
    """The Gaussians of the object, and notes on those left out: detached ones, and a background around it."""
    keep = apart.coherent(trained.means)
    notes: tuple[str, ...] = ()
    if not keep.all():
        notes = (f"{int((~keep).sum())} Gaussians float apart from the object and were dropped.",)
    trained = _select(trained, keep)
    shell = apart.background(trained.means)
    if not shell.any():
        return trained, notes
    rest, again = _object(_select(trained, ~shell))
    share, ratio = shell.mean(), np.ptp(trained.means, axis=0).max() / np.ptp(rest.means, axis=0).max()
    note = (
        f"{int(shell.sum())} Gaussians ({share:.0%}) lie on a shell {ratio:.0f} times as wide as the rest: it was "
        "taken for the background and dropped. If it is the object, crop what lies within it, as in SuperSplat."
    )
    return rest, (*notes, note, *again)


def _placed(trained: Gaussians, asset: Asset, frame: LatticeFrame) -> Gaussians:
    """The Gaussians in the frame; their coefficients are for directions of the world."""
    R = place.rotation(asset.rotate_deg)
    turned = trained.means @ R.T
    placement = place.fit(asset, turned.min(axis=0), turned.max(axis=0))
    sh = harmonics.turned(trained.sh, R) if any(asset.rotate_deg) else trained.sh
    if frame.degrees:
        placement = placement.turned(frame.R.T)
    covariance = placement.scale**2 * (placement.R @ trained.covariance @ placement.R.T)
    return replace(trained, means=placement.to_world(trained.means), covariance=covariance, sh=sh)


def _bounded(trained: Gaussians, spacing: float) -> tuple[Gaussians, int]:
    """The Gaussians with standard deviations clamped to [SHORTEST, LONGEST] spacings; the number of too long ones."""
    variances, vectors = np.linalg.eigh(trained.covariance)
    bounded = np.clip(variances, (SHORTEST * spacing) ** 2, (LONGEST * spacing) ** 2)
    long = int((variances[:, 2] > bounded[:, 2]).sum())
    return replace(trained, covariance=np.einsum("nij,nj,nkj->nik", vectors, bounded, vectors)), long


def _inner(body: enclose.Body, axes: list[Array], means: Array, spacing: float) -> fill.Filling:
    """Particles at lattice points inside a body, clear of the Gaussians at `means` (N, 3).

    The lattice is given by three coordinate arrays.
    """
    cells = np.argwhere(body.inside & ~body.shell)
    X = fill.points(axes, cells)
    gap, _ = cKDTree(means).query(X, distance_upper_bound=spacing)
    clear = gap > CLEAR * spacing
    X, depth = X[clear], body.depth[tuple(cells[clear].T)] * spacing
    n = len(X)
    return fill.Filling(X, np.zeros(n), depth, np.zeros((n, 3)), np.zeros(n, bool))


def _notes(long: int, body: enclose.Body) -> tuple[str, ...]:
    """Notes for the user."""
    notes = []
    if long:
        notes.append(f"{long} Gaussians were shortened to a standard deviation of {LONGEST:g} particle spacings.")
    if body.gaps:
        notes.append(f"Gaps in the surface of up to {2 * body.gaps} particle spacings were closed to find the inside.")
    if body.opened:
        notes.append(
            f"The surface is open on one side, as an underside that no camera saw: {body.opened:.0%} of the inside was "
            "found by rays that meet the surface in most directions, and filled. If the object is a vessel, give it as "
            "a mesh with walls (asset.kind=mesh)."
        )
    if body.hollow > NOTED:
        notes.append(
            f"The object stayed hollow where it may be solid: cells as many as {body.hollow:.0%} of its own lie within "
            "its surface on most sides. If it is solid, close the surface, or give it as a closed mesh "
            "(asset.kind=mesh)."
        )
    if not (body.inside & ~body.shell).any():
        notes.append(
            "The Gaussians enclose nothing: only their shell is simulated. If the object is solid, close its surface, "
            "or give it as a closed mesh (asset.kind=mesh)."
        )
    return tuple(notes)


def _particles(
    trained: Gaussians, inner: fill.Filling, volume: Array, sh: Array, spacing: float, notes: tuple[str, ...]
) -> Particles:
    """Particles of volumes (N,) [m^3] and coefficients sh (N, K, 3): trained Gaussians first, then interior ones."""
    X = np.concatenate([trained.means, inner.X])
    inner_covariance = gaussians.covariance(inner, spacing)
    return Particles(
        X=X.astype(np.float32),
        volume=volume.astype(np.float32),
        covariance=np.concatenate([ply.triangle(trained.covariance), inner_covariance]).astype(np.float32),
        opacity=np.concatenate([trained.opacity, np.full(len(inner.X), gaussians.OPACITY)]).astype(np.float32),
        sh=sh,
        surface=np.arange(len(X)) < len(trained.means),
        spacing=spacing,
        notes=notes,
    )


def _inner_colours(
    trained: Gaussians, inner: fill.Filling, asset: Asset, spacing: float, seed: int
) -> Array:  # fmt: skip
    """Colours (N, 3) of interior particles: near the surface those of the nearest Gaussians, deeper the inside's."""
    surface_rgb = np.clip(0.5 + gaussians.SH_C0 * trained.sh[:, 0], 0.0, 1.0)
    rgb = paint.inside(asset.interior, surface_rgb, (inner.X - place.HOME) / asset.size, seed)
    under = np.flatnonzero(inner.depth < paint.DEEP * spacing)
    k = min(4, len(surface_rgb))
    near = cKDTree(trained.means).query(inner.X[under], k=k)[1].reshape(len(under), k)
    weight = trained.opacity[near]
    share = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9)
    above = np.einsum("nk,nkc->nc", share, surface_rgb[near])
    rgb[under] = paint.blend(above, rgb[under], inner.depth[under] / spacing)
    return rgb
