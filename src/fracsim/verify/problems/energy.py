"""Where the work of the grips goes in a bar that is pulled until it tears, and for a while after."""

from collections.abc import Iterator

from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.problem import Check, Setting, absolute, told
from fracsim.verify.pull import Bar, simulator

MATERIALS = {
    "undamped": Material(law="fixed_corotated", E=2e3, nu=0.3),
    "bread": Material(law="fixed_corotated", E=2e3, nu=0.3, viscosity=44.444444, decay=5.0012504),
}
BAR, FRACTURE = Bar(gauge=0.64, width=0.16, height=0.16), Fracture(onset=1.5, crit=2.3)
SPEED, STRETCH, FRAMES = 0.1, 2.0, 80
"""Of each grip / wave speed; nominal stretch at the end, beyond the break; frames."""


def run(setting: Setting) -> Iterator[Check]:
    """All headings as parts of the external work, the losses of the transfers among them, and what the books leave."""
    for name, material in MATERIALS.items():
        bar = simulator(setting.solver(50), BAR, material, FRACTURE, SPEED, STRETCH, FRAMES)
        for _ in bar.frames():
            pass
        energy = bar.report.energy()
        work = energy.pop("grip_work") + energy.pop("gravity_work")
        yield told(f"{name}: work of the grips", work, "J")
        left = energy.pop("unaccounted") / work
        for heading, joule in energy.items():
            yield told(f"{name}: {heading} / work", joule / work)
        yield absolute(f"{name}: left over / work", 0, left, 0.02)
