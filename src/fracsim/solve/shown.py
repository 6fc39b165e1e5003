"""What a frame shows of material that is stretched beyond lambda_crit.

Material that cannot fail, as what a grip holds, has no bound. Shown as it is, it would be needles across the picture,
and the largest value of a clip would be that of material at the grips. The simulation itself knows no such cap.
"""

import numpy as np

from fracsim.mpm.state import State
from fracsim.records import Array


def capped(F: Array, most: float, stretch: Array) -> tuple[Array, Array]:
    """F (N, 3, 3) with stretches of at most `most`, rotations and directions kept, and where it differs, (N,) bool.

    `stretch`, (N,), is the largest one of each. F itself where none differs.
    """
    beyond = stretch > most
    if not beyond.any():
        return F, beyond
    U, stretches, V = np.linalg.svd(F[beyond].astype(np.float64))
    out = F.copy()
    out[beyond] = (U * np.minimum(stretches, most)[:, None]) @ V
    return out, beyond


def stress_at(state: State, F: Array) -> Array:
    """Kirchhoff stresses (1 - d) tau [Pa], (N, 3, 3), that the particles of a state would have at F (N, 3, 3)."""
    grad_u = state.points.grad_u.to_numpy()
    state.points.F.from_numpy(F)
    tau = state.observe().tau
    state.points.grad_u.from_numpy(grad_u)
    return tau
