"""Transfers between particles and grid: APIC with the MLS force (Jiang 2015, Hu 2018).

The grid is one flat array of (momentum or velocity, mass) with strides (sx, sy, 1): four numbers that are loaded and
stored together. Sums over the 27 nodes are nested, so that a weight is multiplied once a row, not once a node.
"""

import taichi as ti

from fracsim.mpm.bspline import weights


@ti.func
def gather(grid: ti.template(), at, f, sx, sy, real: ti.template()):
    """Velocity sum_i w v_i and, in units of the cell, the moments sum_i w v_i (x) (x_i - x_p)."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    q = ti.Vector.zero(real, 4)
    mx, my, mz = ti.Vector.zero(real, 4), ti.Vector.zero(real, 4), ti.Vector.zero(real, 4)
    for i in ti.static(range(3)):
        a, b, c = ti.Vector.zero(real, 4), ti.Vector.zero(real, 4), ti.Vector.zero(real, 4)
        for j in ti.static(range(3)):
            r = at + i * sx + j * sy
            middle, upper = wz[1] * grid[r + 1], wz[2] * grid[r + 2]
            row = wz[0] * grid[r] + middle + upper
            a += wy[j] * row
            c += wy[j] * (middle + 2 * upper)
            if ti.static(j > 0):
                b += (j * wy[j]) * row
        q += wx[i] * a
        my += wx[i] * b
        mz += wx[i] * c
        if ti.static(i > 0):
            mx += (i * wx[i]) * a
    v = ti.Vector([q[0], q[1], q[2]])
    columns = [ti.Vector([m[0], m[1], m[2]]) for m in ti.static((mx, my, mz))]
    return v, ti.Matrix.cols([columns[0] - f[0] * v, columns[1] - f[1] * v, columns[2] - f[2] * v])


@ti.func
def scatter(grid: ti.template(), at, f, sx, sy, momentum, affine, mass, atomic: ti.template()):
    """Add w (momentum + affine (x_i - x_p), mass) to the 27 nodes; `affine` is in units of the cell."""
    wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
    m = momentum - affine @ f
    base = ti.Vector([m[0], m[1], m[2], mass])
    gx = ti.Vector([affine[0, 0], affine[1, 0], affine[2, 0], mass * 0])
    gy = ti.Vector([affine[0, 1], affine[1, 1], affine[2, 1], mass * 0])
    gz = ti.Vector([affine[0, 2], affine[1, 2], affine[2, 2], mass * 0])
    for i in ti.static(range(3)):
        plane, py, pz = wx[i] * (base + i * gx), wx[i] * gy, wx[i] * gz
        for j in ti.static(range(3)):
            row, rz = wy[j] * (plane + j * py), wy[j] * pz
            for k in ti.static(range(3)):
                r = at + i * sx + j * sy + k
                if ti.static(atomic):
                    ti.atomic_add(grid[r], wz[k] * (row + k * rz))
                else:
                    grid[r] = grid[r] + wz[k] * (row + k * rz)
