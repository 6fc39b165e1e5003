"""Energy balance of a bar pulled until it tears, and for a while after."""

from collections.abc import Iterator

from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.problem import Check, Setting, absolute, reported
from fracsim.verify.pull import TensileBar, simulator

MATERIALS = {
    "undamped": Material(law="fixed_corotated", E=2e3, nu=0.3),
    "bread": Material(law="fixed_corotated", E=2e3, nu=0.3, viscosity=44.444444, decay=5.0012504),
}
BAR, FRACTURE = TensileBar(gauge=0.64, width=0.16, height=0.16), Fracture(onset=1.5, crit=2.3)
SPEED, STRETCH, FRAMES = 0.1, 2.0, 80
"""Speed of each grip / wave speed; final nominal stretch, beyond the break; frames."""


def run(setting: Setting) -> Iterator[Check]:
    """All parts of the external work, the losses of the transfers included, and the part not accounted for."""
    for name, material in MATERIALS.items():
        sim = simulator(setting.solver(50), BAR, material, FRACTURE, SPEED, STRETCH, FRAMES)
        for _ in sim.frames():
            pass
        energy = sim.report.energy()
        work = energy.pop("grip_work") + energy.pop("gravity_work")
        yield reported(f"{name}: work of the grips", work, "J")
        left = energy.pop("unaccounted") / work
        for heading, joule in energy.items():
            yield reported(f"{name}: {heading} / work", joule / work)
        yield absolute(f"{name}: left over / work", 0, left, 0.02)
