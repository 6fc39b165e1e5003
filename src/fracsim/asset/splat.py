"""A trained 3DGS checkpoint as particles (asset.kind=ply): its Gaussians on the surface, new ones inside.

Each trained Gaussian becomes a surface particle that keeps its covariance and colour; standard deviations are limited
to LONGEST spacings (one and a half cells), for a particle moves as one and cannot span a crack. The inside is what
the opaque cells enclose, closed over small gaps. Checkpoints are often y down: asset.rotate_deg=[180,0,0] turns them.
"""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from fracsim.asset import enclose, fill, gaussians, harmonics, limits, paint, place, ply
from fracsim.records import Array, Particles
from fracsim.scene.vocab import Asset

LONGEST, SHORTEST = 3.0, 0.02
"""Bounds of standard deviations, in spacings."""
CLEAR = 0.6
"""Interior particles keep this distance from trained Gaussians, in spacings."""
LEAST = 0.02
"""Least volume of a particle before the total is set right, in cells: many Gaussians share a cell."""


def prepare(asset: Asset, spacing: float, seed: int) -> Particles:
    """Particles of the checkpoint asset.path; raises ValueError when it cannot be used."""
    trained, notes = _opaque(ply.read(asset.path), asset)
    limits.count(asset, spacing, len(trained.means), "at least ")
    trained, floaters = _placed(trained, asset)
    trained, long = _bounded(trained, spacing)
    lo, hi = trained.means.min(axis=0), trained.means.max(axis=0)
    limits.estimate(asset, spacing, 0.0, 0.0, (lo, hi))
    axes = fill.lattice(lo, hi, spacing)
    body = enclose.enclose(trained, axes, spacing)
    inner = _inner(body, axes, trained.means, spacing)
    limits.count(asset, spacing, len(trained.means) + len(inner.X))
    notes = (*notes, *_remarks(floaters, long, body))
    return _together(trained, inner, body, axes, asset, spacing, seed, notes)


def _opaque(trained: ply.Gaussians, asset: Asset) -> tuple[ply.Gaussians, tuple[str, ...]]:
    """The Gaussians of at least asset.opacity_threshold; raises ValueError when none is."""
    keep = trained.opacity >= asset.opacity_threshold
    if not keep.any():
        raise ValueError(
            f"asset.opacity_threshold={asset.opacity_threshold:g} drops all {len(keep)} Gaussians of "
            f"asset.path={asset.path}: set it below {trained.opacity.max():.3g}, the opacity of the most opaque."
        )
    dropped = int((~keep).sum())
    note = (f"{dropped} of {len(keep)} Gaussians are less opaque than {asset.opacity_threshold:g} and were dropped.",)
    return _those(trained, keep), note if dropped else ()


def _those(trained: ply.Gaussians, keep: Array) -> ply.Gaussians:
    return ply.Gaussians(trained.means[keep], trained.covariance[keep], trained.opacity[keep], trained.sh[keep])


def _placed(trained: ply.Gaussians, asset: Asset) -> tuple[ply.Gaussians, int]:
    """The Gaussians in the world without those that float apart from the object, and how many those were."""
    keep = enclose.together(trained.means)
    trained = _those(trained, keep)
    R = place.rotation(asset.rotate_deg)
    turned = trained.means @ R.T
    placement = place.fit(asset, turned.min(axis=0), turned.max(axis=0))
    covariance = placement.scale**2 * (R @ trained.covariance @ R.T)
    sh = harmonics.turned(trained.sh, R) if any(asset.rotate_deg) else trained.sh
    means = placement.to_world(trained.means)
    return replace(trained, means=means, covariance=covariance, sh=sh), int((~keep).sum())


def _bounded(trained: ply.Gaussians, spacing: float) -> tuple[ply.Gaussians, int]:
    """The Gaussians with standard deviations within [SHORTEST, LONGEST] spacings, and how many were too long."""
    variances, axes = np.linalg.eigh(trained.covariance)
    bounded = np.clip(variances, (SHORTEST * spacing) ** 2, (LONGEST * spacing) ** 2)
    long = int((variances[:, 2] > bounded[:, 2]).sum())
    return replace(trained, covariance=np.einsum("nij,nj,nkj->nik", axes, bounded, axes)), long


def _inner(body: enclose.Body, axes: list[Array], means: Array, spacing: float) -> fill.Filling:
    """Lattice particles within a body, clear of the trained Gaussians at `means` (N, 3)."""
    cells = np.argwhere(body.inside & ~body.shell)
    X = fill.points(axes, cells)
    gap, _ = cKDTree(means).query(X, distance_upper_bound=spacing)
    clear = gap > CLEAR * spacing
    X, depth = X[clear], body.depth[tuple(cells[clear].T)] * spacing
    n = len(X)
    return fill.Filling(X, np.zeros(n), depth, np.zeros((n, 3)), np.zeros(n, bool))


def _remarks(floaters: int, long: int, body: enclose.Body) -> tuple[str, ...]:
    """What a user should know."""
    notes = []
    if floaters:
        notes.append(f"{floaters} Gaussians float apart from the object and were dropped.")
    if long:
        notes.append(f"{long} Gaussians were shortened to a standard deviation of {LONGEST:g} particle spacings.")
    if body.gaps:
        notes.append(f"Gaps in the surface of up to {2 * body.gaps} particle spacings were closed to find the inside.")
    if not (body.inside & ~body.shell).any():
        notes.append("The Gaussians enclose nothing: only their shell is simulated. Raise solver.cells if it is solid.")
    return tuple(notes)


def _together(
    trained: ply.Gaussians, inner: fill.Filling, body: enclose.Body, axes: list[Array], asset: Asset,
    spacing: float, seed: int, notes: tuple[str, ...],
) -> Particles:  # fmt: skip
    """Trained Gaussians first, interior particles after them."""
    X = np.concatenate([trained.means, inner.X])
    shape = gaussians.covariance(inner, spacing)
    sh = np.zeros((len(X), *trained.sh.shape[1:]), np.float32)
    sh[: len(trained.sh)] = trained.sh
    sh[len(trained.sh) :, :1] = gaussians.constant_sh(_inner_colours(trained, inner, asset, spacing, seed))
    return Particles(
        X=X.astype(np.float32),
        volume=(body.shared(X, axes, LEAST) * spacing**3).astype(np.float32),
        covariance=np.concatenate([ply.triangle(trained.covariance), shape]).astype(np.float32),
        opacity=np.concatenate([trained.opacity, np.full(len(inner.X), gaussians.OPACITY)]).astype(np.float32),
        sh=sh,
        surface=np.arange(len(X)) < len(trained.means),
        spacing=spacing,
        notes=notes,
    )


def _inner_colours(
    trained: ply.Gaussians, inner: fill.Filling, asset: Asset, spacing: float, seed: int
) -> Array:  # fmt: skip
    """Colours (N, 3) of interior particles: near the surface that of the Gaussians there, then the inside's own."""
    skin = np.clip(0.5 + gaussians.SH_C0 * trained.sh[:, 0], 0.0, 1.0)
    rgb = paint.inside(asset.interior, skin, (inner.X - place.HOME) / asset.size, seed)
    under = np.flatnonzero(inner.depth < paint.DEEP * spacing)
    k = min(4, len(skin))
    near = cKDTree(trained.means).query(inner.X[under], k=k)[1].reshape(len(under), k)
    weight = trained.opacity[near]
    above = np.einsum("nk,nkc->nc", weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9), skin[near])
    rgb[under] = paint.blend(above, rgb[under], inner.depth[under] / spacing)
    return rgb
