"""Where the work of the grips goes in a bar that is pulled until it tears, and for a while after."""

from collections.abc import Iterator

import numpy as np

from fracsim.mpm import params as slot
from fracsim.mpm.state import State
from fracsim.simulate import Simulator
from fracsim.verify.problem import Check, Setting, absolute, told
from fracsim.verify.pull import Bar, simulator
from fracsim.verify.stage import kinetic
from fracsim.vocab import Fracture, Material

MATERIALS = {
    "undamped": Material(law="fixed_corotated", E=2e3, nu=0.3),
    "bread": Material(law="fixed_corotated", E=2e3, nu=0.3, viscosity=44.444444, decay=5.0012504),
}
BAR, FRACTURE = Bar(gauge=0.64, width=0.16, height=0.16), Fracture(onset=1.5, crit=2.3)
SPEED, STRETCH, FRAMES = 0.1, 2.0, 80
"""Of each grip / wave speed; nominal stretch at the end, beyond the break; frames, two or three substeps each."""
SAVED = ("U", "V", "C", "F", "D", "books")


def on_grid(state: State) -> float:
    """Kinetic energy of the nodes in the last substep [J]; NaN when the grid has been laid anew since."""
    nodes = state.velocity.to_numpy().astype(float)
    energy = float((nodes[:, 3] / 2 * (nodes[:, :3] ** 2).sum(axis=1)).sum())
    return energy if nodes[:, 3].any() else float("nan")


def transfer_loss(state: State, t: float) -> float:
    """Kinetic energy lost from the grid of the last substep, by way of the particles, to the next grid [J].

    The next grid is that of the solver's own substep of no length, after which everything is as before; what the grips,
    decay and viscosity book meanwhile is theirs. On a grid without a past, the loss of a round trip of the particles.
    """
    saved = {name: getattr(state, name).to_numpy() for name in SAVED}
    last, before, booked = on_grid(state), kinetic(state), state.booked()
    state.run(1, 1e-9 * state.scene.solver.h, t)
    after, work = kinetic(state), state.booked() - booked
    lost = before - after if np.isnan(last) else last - on_grid(state)
    for name, values in saved.items():
        getattr(state, name).from_numpy(values)
    return lost + float(work[slot.GRIP_WORK] - work[slot.DECAYED] - work[slot.VISCOUS] - work[slot.RELEASED])


def spent_in_transfers(bar: Simulator) -> float:
    """Run to the end; the loss of the transfers, sampled at each frame, over all substeps [J]."""
    total, before, done = 0.0, 0.0, 0
    for frame in bar.frames():
        loss = transfer_loss(bar.state, frame.t)
        total += (loss + before) / 2 * (bar.report.substeps - done)
        before, done = loss, bar.report.substeps
    return total


def run(setting: Setting) -> Iterator[Check]:
    """All headings as parts of the external work; what the books leave, and what of it the transfers take."""
    for name, material in MATERIALS.items():
        bar = simulator(setting.solver(50), BAR, material, FRACTURE, SPEED, STRETCH, FRAMES)
        measured = spent_in_transfers(bar)
        energy = bar.report.energy()
        work = energy.pop("grip_work") + energy.pop("gravity_work")
        yield told(f"{name}: work of the grips", work, "J")
        left = energy.pop("transfer") / work
        for heading, joule in energy.items():
            yield told(f"{name}: {heading} / work", joule / work)
        yield absolute(f"{name}: left over / work", 0, left, 0.02)
        yield told(f"{name}: transfers of APIC / work", measured / work)
        yield absolute(f"{name}: left over without these / work", 0, left - measured / work, 0.02)
