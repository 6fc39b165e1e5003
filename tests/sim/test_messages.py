"""Messages of a simulation that stopped: the likely cause and the way out."""

import numpy as np

from fracsim import Material, Scene
from fracsim.mpm import params as slot
from fracsim.solve import messages
from fracsim.solve.setup import medium


def test_a_particle_as_fast_as_the_waves_of_a_stiff_solid_is_no_sign_of_a_long_substep() -> None:
    """E = 1e9 Pa, density 100: waves at 3.2 km/s; what recoils at 600 m/s is within the law."""
    stiff = medium(Scene(material=Material(E=1e9, density=100)))
    message = messages.fault(stiff, slot.SPEED_FAULT, "particle 3", np.zeros(3), np.array([600.0, 0, 0]))
    assert "v = 600 m/s exceeds solver.max_speed=500" in message
    assert message.endswith("waves run at 3.16e+03 m/s: raise solver.max_speed.")
    message = messages.fault(stiff, slot.SPEED_FAULT, "particle 3", np.zeros(3), np.array([np.nan, 0, 0]))
    assert "v is not finite" in message
    assert "use solver.dt=auto" in message
