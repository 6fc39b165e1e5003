"""Transfers between the nodes of WIDTH cells and a particle of each: `fracsim.mpm.transfer`, with a particle a lane."""

import numpy as np
import taichi as ti

from fracsim.lanes import WIDTH, entry, held, inline, matrix, vector

NODES, SUMS, PLACES = 0, 81, 200
"""Places of a pad: the velocities of the 27 nodes of each cell, three vectors a node, and what particles add to them,
four vectors a node. A thread has PLACES of them, of which it leaves the last ones free: threads that write to one cache
line, or to its neighbour, halve each other's speed."""


@ti.func
def fetch_nodes(at: ti.template(), o, pad: ti.template(), g: ti.template()):
    """Put the velocities of the 27 nodes of each cell on the pad from o on; `at` are the lowest nodes."""
    for k in range(27):
        to = k // 9 * g.sx + k // 3 % 3 * g.sy + k % 3
        x, y, z = turned_in([g.velocity[at[l] + to] for l in ti.static(range(WIDTH))])
        for m, values in ti.static(enumerate((x, y, z))):
            pad[o + NODES + 3 * k + m] = values


@ti.func
def turned_in(each: ti.template()):
    """The first three numbers of each of eight nodes, as three vectors.

    By halves of registers: what takes its entries from two vectors is one instruction.
    """
    a, b, c, d = [halves(each[k], each[k + 4]) for k in ti.static(range(4))]
    xy, zw, XY, ZW = low(a, b), high(a, b), low(c, d), high(c, d)
    return joined(xy, XY), joined_high(xy, XY), joined(zw, ZW)


@ti.func
def turned_out(x, y, z, w):
    """Four vectors as the four numbers of each of eight nodes, two nodes a vector: 0 and 4, 1 and 5, and so on."""
    xy, XY, zw, ZW = low(x, y), high(x, y), low(z, w), high(z, w)
    return joined(xy, zw), joined_high(xy, zw), joined(XY, ZW), joined_high(XY, ZW)


@ti.func
def halves(a, b):
    """Eight numbers from four and four."""
    return vector([a[0], a[1], a[2], a[3], b[0], b[1], b[2], b[3]])


@ti.func
def low(a, b):
    """In turns, the lower numbers of the halves of two vectors."""
    return vector([a[0], b[0], a[1], b[1], a[4], b[4], a[5], b[5]])


@ti.func
def high(a, b):
    """In turns, the upper numbers of the halves of two vectors."""
    return vector([a[2], b[2], a[3], b[3], a[6], b[6], a[7], b[7]])


@ti.func
def joined(a, b):
    """The lower pairs of the halves of two vectors."""
    return vector([a[0], a[1], b[0], b[1], a[4], a[5], b[4], b[5]])


@ti.func
def joined_high(a, b):
    """The upper pairs of the halves of two vectors."""
    return vector([a[2], a[3], b[2], b[3], a[6], a[7], b[6], b[7]])


@ti.func
def gather_lanes(o, pad: ti.template(), f: ti.template()):
    """Velocity sum_i w v_i, three vectors, and in units of the cell the moments sum_i w v_i (x) (x_i - x_p)."""
    w = [weights_of(f[0]), weights_of(f[1]), weights_of(f[2])]
    sums = [nested(o, pad, m, w) for m in ti.static(range(3))]
    moments = matrix([[sums[m][k + 1] - f[k] * sums[m][0] for k in ti.static(range(3))] for m in ti.static(range(3))])
    return [sums[m][0] for m in ti.static(range(3))], moments


@ti.func
def weights_of(f):
    """The three weights along one axis."""
    return [(1.5 - f) * (1.5 - f) / 2, 0.75 - (f - 1) * (f - 1), (f - 0.5) * (f - 0.5) / 2]


@inline
def nested(o, pad, m, w):
    """sum_i w v and sum_i w k v for the offsets k of the nodes along x, y and z, where v is number m of a node."""
    x, y, z = w
    n = held([entry(pad, o + (NODES + 3 * k + m)) for k in range(27)])
    lines = held([z[0] * n[3 * i] + z[1] * n[3 * i + 1] + z[2] * n[3 * i + 2] for i in range(9)])
    along = held([z[1] * n[3 * i + 1] + (2 * z[2]) * n[3 * i + 2] for i in range(9)])
    planes = held([y[0] * lines[3 * i] + y[1] * lines[3 * i + 1] + y[2] * lines[3 * i + 2] for i in range(3)])
    by_y = [y[1] * lines[3 * i + 1] + (2 * y[2]) * lines[3 * i + 2] for i in range(3)]
    by_z = [y[0] * along[3 * i] + y[1] * along[3 * i + 1] + y[2] * along[3 * i + 2] for i in range(3)]
    return [
        x[0] * planes[0] + x[1] * planes[1] + x[2] * planes[2],
        x[1] * planes[1] + (2 * x[2]) * planes[2],
        x[0] * by_y[0] + x[1] * by_y[1] + x[2] * by_y[2],
        x[0] * by_z[0] + x[1] * by_z[1] + x[2] * by_z[2],
    ]


@ti.func
def clear_sums(o, pad: ti.template()):
    """Empty the sums."""
    for k in range(108):
        pad[o + SUMS + k] = 0 * pad[o + SUMS + k]


@inline
def scatter_lanes(o, pad, f, momentum, affine, mass):
    """Add w (momentum + affine (x_i - x_p), mass) to the sums of the 27 nodes."""
    x, y, z = (held(weights_of(component)) for component in f)
    mass = held(mass)

    def add(i, j, k, m, value):
        sum = entry(pad, o + (SUMS + 4 * (9 * i + 3 * j + k) + m))
        sum._assign(sum + value)

    for m in range(3):
        a = affine.rows[m]
        base = held(momentum[m] - a[0] * f[0] - a[1] * f[1] - a[2] * f[2])
        for k in range(3):
            plane, by_x, by_y = held([z[k] * (base + k * a[2]), z[k] * a[0], z[k] * a[1]])
            for j in range(3):
                line, slope = held([y[j] * (plane + j * by_y), y[j] * by_x])
                for i in range(3):
                    add(i, j, k, m, x[i] * (line + i * slope))
    for i, j in np.ndindex(3, 3):
        w = held(x[i] * y[j] * mass)
        for k in range(3):
            add(i, j, k, 3, z[k] * w)


@ti.func
def add_to_nodes(at: ti.template(), o, pad: ti.template(), g: ti.template()):
    """Add the sums to the nodes of each cell."""
    for k in range(27):
        to = k // 9 * g.sx + k // 3 % 3 * g.sy + k % 3
        x, y, z, w = [pad[o + SUMS + 4 * k + m] for m in ti.static(range(4))]
        pairs = turned_out(x, y, z, w)
        for l in ti.static(range(WIDTH)):
            n, half = at[l] + to, ti.static(4 * (l // 4))
            sums = ti.Vector([pairs[l % 4][half + m] for m in ti.static(range(4))])
            g.momentum[n] = g.momentum[n] + sums
