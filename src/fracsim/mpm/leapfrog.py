"""What the first substep of a call does differently: nodes may have no velocity yet, and substeps change their length.

Velocities are those of the middle of a substep. Forces act from one middle to the next: over the mean of two substeps.
Over the new one alone, each change of dt would shift the energy by half of it times the power of the stress.
"""

import taichi as ti

from fracsim.mpm.params import ALPHA, DT, FIRST, KICK


@ti.func
def projected_part(step, c: ti.template()):
    """Part of their momentum that particles give to the nodes: all of it while nodes have no velocity."""
    return ti.max(c.params[ALPHA], c.params[FIRST]) if step == 0 else c.params[ALPHA]


@ti.func
def kick(step, c: ti.template()):
    """Time over which forces act [s]."""
    return c.params[KICK] if step == 0 else c.params[DT]
