"""Why a simulation stopped: which particle, when, which field, the likely cause and the way out."""

import math

import numpy as np

from fracsim.asset.frame import WORLD, LatticeFrame
from fracsim.mpm import params as slot
from fracsim.mpm.medium import Medium
from fracsim.mpm.state import State
from fracsim.records import Array
from fracsim.scene.vocab import CENTRE

PATIENCE = 100
"""With dt auto, a run stops that has taken this many times the substeps that all of it takes at rest."""


def fault(medium: Medium, kind: int, when: str, x: Array, v: Array) -> str:
    """The message for a fault of a particle at x [m], (3,), with velocity v [m/s], (3,); `when` names it."""
    where = f"{when} at {x.round(3)} m"
    if kind == slot.GRID_FAULT:
        return (
            f"{where} left the grid (field x): it flew off, or the motion is larger than the grid. "
            "Use solver.formulation=total, or fewer capture.frames."
        )
    limit, material = medium.solver.max_speed, medium.material
    what = f"v = {np.linalg.norm(v):.3g} m/s exceeds solver.max_speed={limit:g}"
    wave = math.sqrt(material.E / material.density)
    if np.isfinite(v).all() and wave > limit / 2 and medium.solver.dt == "auto":
        return f"{where}: field {what}, but this material's waves run at {wave:.3g} m/s: raise solver.max_speed."
    return (
        f"{where}: field {what if np.isfinite(v).all() else 'v is not finite'}. The simulation is unstable, "
        "likely because the substep is too long: use solver.dt=auto or a smaller solver.safety."
    )


def of_state(state: State, frame: int, before: int, lattice: LatticeFrame = WORLD) -> str:
    """The message for the fault of a state, or ""; `before` substeps were made before its last run.

    `lattice` is the frame of the state.
    """
    kind, p, step = state.fault()
    if kind == slot.NO_FAULT:
        return ""
    x = state.X0[p] + state.points.U.to_numpy()[p] + np.asarray(CENTRE)
    when = f"frame {frame}, substep {max(before + step, 0)}, particle {p}"
    return fault(state.medium, kind, when, lattice.points_to_world(x), state.points.V.to_numpy()[p])


def crushed(state: State, when: str, many: float) -> str:
    """The message for too many inverted or crushed particles, `many` a substep; names the worst of them."""
    b = state.points
    J = np.where(b.D.to_numpy() < 1, np.linalg.det(b.F.to_numpy()), np.inf)
    p = int(J.argmin())
    return (
        f"{when}: {many:.0f} particles a substep are inverted or crushed, the worst by now is particle {p} (field F, "
        f"J = {J[p]:.2g}; crushed is below 0.05). Likely the substep is too long or the thresholds let the material "
        "stretch too far: use solver.dt=auto or a smaller solver.safety."
    )


def slow(state: State, when: str, dt: float) -> str:
    """The message when the stability bound has fallen too far, to dt [s]; names the thinnest particle."""
    intact = np.flatnonzero(state.points.D.to_numpy() < 1)
    stretch = np.linalg.svd(state.points.F.to_numpy()[intact], compute_uv=False)
    p = int(stretch[:, 2].argmin())
    way_out = "fracture.at_grips=true, so that it may fail" if state.exempt[intact[p]] else "a slower loading.speed"
    return (
        f"{when}: the run has taken {PATIENCE} times the substeps that all of it takes at rest, since solver.dt=auto "
        f"is down to {dt:.2g} s: particle {intact[p]} (field F) has stretches from {stretch[p, 2]:.2g} to "
        f"{stretch[p, 0]:.3g}. Use {way_out}, or fewer capture.frames."
    )


def fixed_dt(dt: float, bound: float, frame: int) -> str:
    """The warning for a fixed dt [s] beyond the bound [s] of the present state."""
    return (
        f"solver.dt={dt:g} s exceeds the stability bound at the present stretch, {bound:.3g} s, from frame {frame} on: "
        "use solver.dt=auto"
    )
