"""Bodies that no grip holds, and their momentum."""

import numpy as np

from fracsim.mpm import params as slot
from fracsim.mpm.layout import Layout
from fracsim.mpm.state import State
from fracsim.records import Array, Particles
from fracsim.vocab import Scene


class FreeState(State):
    """A state whose nodes no grip holds."""

    def _place_grid(self, grid: Layout, x: Array) -> None:
        super()._place_grid(grid, x)
        self.owner.fill(0)


def free(scene: Scene, body: Particles) -> State:
    """A state whose particles and nodes no grip holds, at rest."""
    state = FreeState(scene, body)
    state.K[slot.HALF] = -1.0
    state.label.from_numpy(np.full(len(body), slot.FREE, np.int32))
    state.V.from_numpy(np.zeros((len(body), 3), state.dtype))
    return state


def momentum(state: State) -> Array:
    """Total linear momentum [kg m/s]."""
    m = state.scene.material.density * state.volume.to_numpy().astype(np.float64)
    out: Array = (m[:, None] * state.V.to_numpy()).sum(axis=0)
    return out
