"""Transfers between particles and grid: APIC with the MLS force (Jiang 2015, Hu 2018).

The grid is one flat array of (momentum or velocity, mass) with strides (sx, sy, sz): four numbers that belong together.
Sums over the 27 nodes are nested, so that a weight is multiplied once a row, not once a node.

On a CPU half of a substep is spent here, and LLVM moves four numbers by one instruction only where it sees that they
lie side by side and that all four are treated alike. Three habits take a third off the time of a substep. The
stride sz is 1, which the compiler does not know, so that an address is 4 times something. The fourth number of a
gradient is added although it is `zero`, which is 0 at run time. Partial sums of `gather` go to memory that was read
before (a pad): the pattern that LLVM packs.
"""

from typing import Any, NamedTuple

import taichi as ti

from fracsim.mpm.bspline import weights

PAD = 64
"""Places of a thread's pad, four numbers each; a multiple of 4, so that threads share no cache line."""
ROW, PLANE = 4, 22
"""Where sums over rows and planes lie in a pad; the results are in its first four places."""


class Grid(NamedTuple):
    """Nodes of a dense box, as the transfers see them."""

    sx: Any
    sy: Any
    sz: Any
    """Strides of the three axes; sz is 1."""
    velocity: Any
    """Velocity [m/s] and mass [kg] of each node of the box, (size,) vec4."""
    momentum: Any
    """Momentum [kg m/s] and mass [kg] that each thread has scattered to its copy of the nodes, (copies,) vec4."""
    pad: Any
    """Scratch memory of all threads, (threads * PAD,) vec4."""
    zero: Any
    """0 at run time."""
    atomic: bool
    """Whether other threads scatter to the same copy."""


@ti.func
def gather(g: ti.template(), row, at, f, real: ti.template()):
    """Velocity sum_i w v_i and, in units of the cell, the moments sum_i w v_i (x) (x_i - x_p)."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    sums = ti.Matrix.zero(real, 4, 3)
    if ti.static(g.atomic):
        sums = sum_in_registers(g, at, wx, wy, wz, real)
    else:
        sums = sum_on_pad(g, row * PAD, at, wx, wy, wz)
    v = ti.Vector([sums[0, 0], sums[0, 1], sums[0, 2]])
    columns = [ti.Vector([sums[k + 1, 0], sums[k + 1, 1], sums[k + 1, 2]]) - f[k] * v for k in ti.static(range(3))]
    return v, ti.Matrix.cols(columns)


@ti.func
def sum_in_registers(g: ti.template(), at, wx, wy, wz, real: ti.template()):
    """As rows, sum_i w v_i and sum_i w k v_i for the offsets k = 0, 1, 2 of the nodes along x, y and z."""
    sums = ti.Matrix.zero(real, 4, 3)
    for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
        node = g.velocity[at + i * g.sx + j * g.sy + k * g.sz]
        wv = (wx[i] * wy[j] * wz[k]) * ti.Vector([node[0], node[1], node[2]])
        sums += ti.Vector([1, i, j, k]).outer_product(wv)
    return sums


@ti.func
def sum_on_pad(g: ti.template(), o, at, wx, wy, wz):
    """The same as `sum_in_registers`, by way of the places from o on of the pad."""
    for i, j in ti.static(ti.ndrange(3, 3)):
        r, to = at + i * g.sx + j * g.sy, o + ROW + 6 * i + 2 * j
        middle, upper = wz[1] * g.velocity[r + g.sz], wz[2] * g.velocity[r + 2 * g.sz]
        put(g, to, wz[0] * g.velocity[r] + middle + upper)
        put(g, to + 1, middle + 2 * upper)
    for i in ti.static(range(3)):
        a, to = o + ROW + 6 * i, o + PLANE + 3 * i
        put(g, to, wy[0] * g.pad[a] + wy[1] * g.pad[a + 2] + wy[2] * g.pad[a + 4])
        put(g, to + 1, wy[1] * g.pad[a + 2] + (2 * wy[2]) * g.pad[a + 4])
        put(g, to + 2, wy[0] * g.pad[a + 1] + wy[1] * g.pad[a + 3] + wy[2] * g.pad[a + 5])
    a = o + PLANE
    put(g, o, wx[0] * g.pad[a] + wx[1] * g.pad[a + 3] + wx[2] * g.pad[a + 6])
    put(g, o + 1, wx[1] * g.pad[a + 3] + (2 * wx[2]) * g.pad[a + 6])
    put(g, o + 2, wx[0] * g.pad[a + 1] + wx[1] * g.pad[a + 4] + wx[2] * g.pad[a + 7])
    put(g, o + 3, wx[0] * g.pad[a + 2] + wx[1] * g.pad[a + 5] + wx[2] * g.pad[a + 8])
    return ti.Matrix([[g.pad[o + k][c] for c in ti.static(range(3))] for k in ti.static(range(4))])


@ti.func
def put(g: ti.template(), place, value):
    """Write four numbers to the pad, by reading them first."""
    g.pad[place] = g.zero * g.pad[place] + value


@ti.func
def projection_loss(part):
    """What a substep loses by projecting this part of the nodes' velocities v on particles, over (nodes' - particles'
    kinetic energy).

    With the projection P v, (v, P v) is twice the particles' kinetic energy; v - part (v - P v) has lost
    part (v, v - P v) less part^2 / 2 |v - P v|^2, which lies between 0, for long waves, and (v, v - P v), for short
    ones: half of that is taken.
    """
    return part * (2 - part / 2)


@ti.func
def kinetic(v, C, h):
    """Kinetic energy a mass of a particle and its affine motion [m^2/s^2]; sum w (x_i - x_p)^2 = h^2 / 4."""
    return (v.norm_sqr() + h * h / 4 * C.norm_sqr()) / 2


@ti.func
def kinetic_of_nodes(g: ti.template(), at, f):
    """Kinetic energy a mass of the nodes around a particle, sum w |v_i|^2 / 2 [m^2/s^2]."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    sum = f[0] * 0
    for i, j, k in ti.ndrange(3, 3, 3):
        node = g.velocity[at + i * g.sx + j * g.sy + k * g.sz]
        sum += (wx[i] * wy[j] * wz[k]) * (node[0] ** 2 + node[1] ** 2 + node[2] ** 2)
    return sum / 2


@ti.func
def velocity_of_nodes(g: ti.template(), at, f):
    """Velocity of the nodes around a particle, sum w v_i [m/s]."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    sum = 0 * f
    for i, j, k in ti.ndrange(3, 3, 3):
        node = g.velocity[at + i * g.sx + j * g.sy + k * g.sz]
        sum += (wx[i] * wy[j] * wz[k]) * ti.Vector([node[0], node[1], node[2]])
    return sum


@ti.func
def scatter(g: ti.template(), at, f, momentum, affine, mass):
    """Add w (momentum + affine (x_i - x_p), mass) to the 27 nodes; `affine` is in units of the cell."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    m = momentum - affine @ f
    base = ti.Vector([m[0], m[1], m[2], mass])
    gx = ti.Vector([affine[0, 0], affine[1, 0], affine[2, 0], g.zero])
    gy = ti.Vector([affine[0, 1], affine[1, 1], affine[2, 1], g.zero])
    gz = ti.Vector([affine[0, 2], affine[1, 2], affine[2, 2], g.zero])
    for i, j in ti.static(ti.ndrange(3, 3)):
        w = wx[i] * wy[j]
        line, slope = w * (base + i * gx + j * gy), w * gz
        for k in ti.static(range(3)):
            r = at + i * g.sx + j * g.sy + k * g.sz
            if ti.static(g.atomic):
                ti.atomic_add(g.momentum[r], wz[k] * (line + k * slope))
            else:
                g.momentum[r] = g.momentum[r] + wz[k] * (line + k * slope)
