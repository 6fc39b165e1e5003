"""Roughness of the pressure in a nearly incompressible bar that is stretched evenly: it should be smooth."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fracsim.lab.stage import NEVER
from fracsim.records import Array
from fracsim.scene.vocab import Material, Solver
from fracsim.verify.closed_form import uniaxial
from fracsim.verify.problem import Check, Setting, absolute, relative, told
from fracsim.verify.pull import Bar, simulator

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


def measure(solver: Solver, nu: float) -> tuple[Array, float, float]:
    """Roughness of the pressure, over the axial stress, in a bar that was pulled slowly; mean axial stress of its
    middle half, and what it should be at the stretch there [Pa]. Pressure is a third of the trace of the Kirchhoff
    stress."""
    material = Material(law="neo_hookean", E=E, nu=nu)
    bar = simulator(solver, BAR, material, NEVER, 0.02, STRETCH, 50)
    *_, last = bar.frames()
    place, shape = box(bar.particles.X.astype(float), bar.particles.spacing)
    pressure = np.full(shape, np.nan)
    pressure[tuple(place.T)] = np.trace(last.stress.astype(float), axis1=1, axis2=2) / 3
    middle = np.abs(bar.particles.X[:, 0] - 1) < BAR.gauge / 4
    axial = E * uniaxial(material.law, nu, float(last.F[middle, 0, 0].mean()))[1]
    quarter = shape[0] // 4
    return roughness(pressure[quarter:-quarter]) / axial, float(last.stress[middle, 0, 0].mean()), axial


def run(setting: Setting) -> Iterator[Check]:
    """With the pressure of the preset, and for comparison with that of each particle."""
    solver = setting.solver(50)
    for nu in RATIOS[:2] if setting.quick else RATIOS:
        rough, stress, axial = measure(solver, nu)
        # As the stress in the runs of other problems: a few per cent.
        rms = float(np.sqrt((rough**2).mean()))
        yield absolute(f"nu = {nu}: rms of p - mean of its neighbours / axial stress", 0, rms, 0.05)
        yield told(f"nu = {nu}: largest of these", float(np.abs(rough).max()))
        yield relative(f"nu = {nu}: mean axial stress", axial, stress, 0.01, unit="Pa")
        if setting.formulation == "total":
            rough, stress, _ = measure(replace(solver, pressure="particle"), nu)
            rms = float(np.sqrt((rough**2).mean()))
            yield absolute(f"nu = {nu}, pressure=particle: rms of p - mean of its neighbours / axial stress", 0, rms)
            yield relative(f"nu = {nu}, pressure=particle: mean axial stress", axial, stress, unit="Pa")
