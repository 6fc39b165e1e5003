"""A uniform bar that fails at the peak of (1 - d) P, long before its critical stretch."""

from collections.abc import Iterator

from fracsim.scene.vocab import Fracture, Material
from fracsim.verify.closed_form import softening
from fracsim.verify.problem import Check, Setting, relative, reported
from fracsim.verify.pull import TensileBar, at_break, at_peak, over_gauge, simulator, until_parted

ROWS = (
    ("fixed_corotated", 2e3, 0.3, 1.5, 2.3, 1.6219, 0.45866, 0.37612),
    ("fixed_corotated", 2e3, 0.3, 2.0, 3.0, 2.0, 0.83668, 0.98086),
    ("neo_hookean", 2e4, 0.45, 2.6, 3.0, 2.6, 0.84209, 0.95255),
    ("neo_hookean", 2e4, 0.49, 3.0, 3.3, 3.0, 0.96892, 1.26778),
)
"""Law, E [Pa], nu, onset, crit; then independently computed: stretch, load / E at the peak, work to failure / E."""
BAR = TensileBar(gauge=0.64, width=0.16, height=0.16)
"""16 x 4 x 4 cells."""


def run(setting: Setting) -> Iterator[Check]:
    """The bars of the table; only the first if quick."""
    for law, E, nu, onset, crit, *table in ROWS[:1] if setting.quick else ROWS:
        stretch, peak, work = softening(law, nu, onset, crit)
        assert max(abs(a - b) for a, b in zip((stretch, peak, work), table, strict=True)) < 1e-4
        material, fracture = Material(law=law, E=E, nu=nu), Fracture(onset=onset, crit=crit)
        sim = simulator(setting.solver(50), BAR, material, fracture, 0.01, stretch + 0.15, 250)
        until_parted(sim)
        name = f"{law} {nu}, {onset:g}/{crit:g}:"
        at, load = at_peak(sim)
        nominal = over_gauge(sim, law, nu, stretch, peak)
        yield relative(f"{name} break stretch", nominal, at_break(sim), 0.02)
        yield relative(f"{name} stretch at the peak", nominal, at, 0.02)
        yield relative(f"{name} peak load / section / E", peak, load / BAR.section / E, 0.01)
        yield reported(f"{name} largest damage at the end", float(sim.state.points.D.to_numpy().max()))
