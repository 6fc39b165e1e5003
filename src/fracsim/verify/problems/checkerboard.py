"""Roughness of the pressure in a uniformly stretched, nearly incompressible bar; the exact pressure is smooth."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from fracsim.lab.stage import NEVER
from fracsim.records import Array
from fracsim.scene.vocab import Material, Solver
from fracsim.verify.closed_form import uniaxial
from fracsim.verify.problem import Check, Setting, absolute, relative, reported
from fracsim.verify.pull import TensileBar, simulator

BAR, E, STRETCH = TensileBar(gauge=0.64, width=0.16, height=0.16), 2e4, 1.5
RATIOS = (0.45, 0.49, 0.499)


def box(X: Array, spacing: float) -> tuple[Array, tuple[int, ...]]:
    """Indices (N, 3) of particles X (N, 3) [m] in a full lattice of pitch `spacing` [m], and its shape."""
    place = np.rint((X - X.min(axis=0)) / spacing).astype(int)
    return place, tuple(place.max(axis=0) + 1)


def roughness(values: Array) -> Array:
    """Values (nx, ny, nz) on a lattice, minus the mean of the six neighbours, at inner points (nx-2, ny-2, nz-2)."""
    inner = (slice(1, -1),) * 3
    sides = [np.roll(values, k, axis)[inner] for axis in range(3) for k in (-1, 1)]
    return np.asarray(values[inner] - np.mean(sides, axis=0))


def measure(solver: Solver, nu: float) -> tuple[Array, float, float]:
    """Of the middle half of a slowly pulled bar: roughness of the pressure over the axial stress, (nx, ny, nz), mean
    axial stress [Pa], and exact axial stress at the mean stretch [Pa].

    The pressure is a third of the trace of the Cauchy stress.
    """
    material = Material(law="neo_hookean", E=E, nu=nu)
    sim = simulator(solver, BAR, material, NEVER, 0.02, STRETCH, 50)
    *_, last = sim.frames()
    place, shape = box(sim.particles.X.astype(float), sim.particles.spacing)
    pressure = np.full(shape, np.nan)
    pressure[tuple(place.T)] = np.trace(last.stress.astype(float), axis1=1, axis2=2) / 3
    middle = np.abs(sim.particles.X[:, 0] - 1) < BAR.gauge / 4
    axial = E * uniaxial(material.law, nu, float(last.F[middle, 0, 0].mean()))[1]
    quarter = shape[0] // 4
    return roughness(pressure[quarter:-quarter]) / axial, float(last.stress[middle, 0, 0].mean()), axial


def run(setting: Setting) -> Iterator[Check]:
    """With the pressure of the preset, and in `total` for comparison with that of each particle."""
    solver = setting.solver(50)
    for nu in RATIOS[:2] if setting.quick else RATIOS:
        rough, stress, axial = measure(solver, nu)
        # The tolerance is of the order of the stress errors of other problems: a few per cent.
        rms = float(np.sqrt((rough**2).mean()))
        yield absolute(f"nu = {nu}: rms of p - mean of its neighbours / axial stress", 0, rms, 0.05)
        yield reported(f"nu = {nu}: largest of these", float(np.abs(rough).max()))
        yield relative(f"nu = {nu}: mean axial stress", axial, stress, 0.01, unit="Pa")
        if setting.formulation == "total":
            rough, stress, _ = measure(replace(solver, pressure="particle"), nu)
            rms = float(np.sqrt((rough**2).mean()))
            yield absolute(f"nu = {nu}, pressure=particle: rms of p - mean of its neighbours / axial stress", 0, rms)
            yield relative(f"nu = {nu}, pressure=particle: mean axial stress", axial, stress, unit="Pa")
