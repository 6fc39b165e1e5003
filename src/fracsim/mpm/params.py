"""Slots of the flat arrays that kernels read and write besides the particles: parameters, books, peaks, faults."""

# Parameters, one number a slot; constant during one call of a kernel.
(DT, TIME, H, MU, LAM, DENSITY, ONSET, CRIT, ETA, KEEP) = range(10)
"""Substep, time at its start, cell size, Lame parameters, density, thresholds, viscosity / 2, velocity kept."""
(SPEED, UX, UY, UZ, REACH, HALF, GX, GY, GZ, MAX_SPEED) = range(10, 20)
"""Grip speed, tearing axis, distance of the grips' middle planes, half their thickness, gravity, speed limit."""
(LX, LY, LZ, ROOM, WALL, RH, ETA_MAX, ALPHA, FRESH, TURN) = range(20, 30)
"""Lowest node of the box, how far a particle may move on it, distance of walls from the centre (0: none), 1 / h,
largest viscosity / 2, projected part of the grid's velocity, whether it is all of it in the first substep,
square of the turn or stretch in a substep that ends the call."""
PARAMETERS = 30

# Books: running sums in SI units, one row a thread.
(PULL_LOW, PULL_HIGH, GRIP_WORK, DECAYED, PROJECTED, VISCOUS, DAMAGED, RELEASED, CLAMPED, GRAVITY_WORK) = range(10)
BOOKS = 10

# Peaks of a survey: maxima over particles, one row a thread.
PEAKS = 4

# Faults: kind, particle, substep; the first one of a thread is kept.
NO_FAULT, SPEED_FAULT, GRID_FAULT = 0, 1, 2

# Tags of particles: grip + 1 in the lowest two bits (0: lower grip, 1: free, 2: upper grip), EXEMPT from damage above.
FREE, EXEMPT = 1, 4
