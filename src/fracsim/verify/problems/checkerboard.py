"""Roughness of the pressure in a nearly incompressible bar that is stretched evenly: it should be smooth."""

from collections.abc import Iterator

import numpy as np

from fracsim.records import Array
from fracsim.verify.closed_form import uniaxial
from fracsim.verify.problem import Check, Setting, absolute, relative, told
from fracsim.verify.pull import Bar, simulator
from fracsim.verify.stage import NEVER
from fracsim.vocab import Material

BAR, E, STRETCH = Bar(gauge=0.64, width=0.16, height=0.16), 2e4, 1.5
RATIOS = (0.45, 0.49, 0.499)


def box(X: Array, spacing: float) -> tuple[Array, tuple[int, ...]]:
    """Index of each particle in a full lattice, and the lattice's shape."""
    place = np.rint((X - X.min(axis=0)) / spacing).astype(int)
    return place, tuple(place.max(axis=0) + 1)


def roughness(values: Array) -> Array:
    """Difference of each inner point of a lattice from the mean of its six neighbours."""
    inner = (slice(1, -1),) * 3
    sides = [np.roll(values, k, axis)[inner] for axis in range(3) for k in (-1, 1)]
    return np.asarray(values[inner] - np.mean(sides, axis=0))


def run(setting: Setting) -> Iterator[Check]:
    """The middle half of a bar, pulled slowly; pressure is a third of the trace of its Kirchhoff stress."""
    for nu in RATIOS[:2] if setting.quick else RATIOS:
        material = Material(law="neo_hookean", E=E, nu=nu)
        bar = simulator(setting.solver(50), BAR, material, NEVER, 0.02, STRETCH, 50)
        *_, last = bar.frames()
        place, shape = box(bar.particles.X.astype(float), bar.particles.spacing)
        pressure = np.full(shape, np.nan)
        pressure[tuple(place.T)] = np.trace(last.stress.astype(float), axis1=1, axis2=2) / 3
        axial = E * uniaxial(material.law, nu, STRETCH)[1]
        quarter = shape[0] // 4
        rough = roughness(pressure[quarter:-quarter]) / axial
        rms = float(np.sqrt((rough**2).mean()))
        # As the stress in the runs of other problems: a few per cent.
        yield absolute(f"nu = {nu}: rms of p - mean of its neighbours / axial stress", 0, rms, 0.05)
        yield told(f"nu = {nu}: largest of these", float(np.abs(rough).max()))
        middle = np.abs(bar.particles.X[:, 0] - 1) < BAR.gauge / 4
        yield relative(f"nu = {nu}: mean axial stress", axial, float(last.stress[middle, 0, 0].mean()), 0.01, unit="Pa")
