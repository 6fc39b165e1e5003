"""Slots of the flat arrays that kernels read and write besides particles and nodes."""

# Parameters: constant during one call of a kernel.
DT = 0  # substep [s]
TIME = 1  # time at the start of the call [s]
CELL = 2  # cell size h [m]
INV_CELL = 3  # 1 / h [1/m]
MU = 4  # shear modulus [Pa]
LAM = 5  # first Lame parameter [Pa]
DENSITY = 6  # mass density at rest [kg/m^3]
ONSET = 7  # lambda_onset [1]
CRIT = 8  # lambda_crit [1]
ETA = 9  # viscosity [Pa s]
ETA_MAX = 10  # largest viscosity that a particle can bear in this substep [Pa s]
KEEP = 11  # part of its velocity that a node keeps in a substep [1]
ALPHA = 12  # part of the nodes' velocity that a substep replaces by its projection [1]
FIRST = 13  # 1 if nodes have no velocity of their own yet, else 0
SPEED = 14  # speed of each grip [m/s]
UX = 15  # tearing axis, x [1]
UY = 16  # tearing axis, y [1]
UZ = 17  # tearing axis, z [1]
REACH = 18  # distance of the grips' middle planes from the object's centre at rest [m]
HALF = 19  # half the thickness of what a grip holds [m]
GX = 20  # acceleration of gravity, x [m/s^2]
GY = 21  # acceleration of gravity, y [m/s^2]
GZ = 22  # acceleration of gravity, z [m/s^2]
WALL = 23  # distance of sticky walls from the object's centre, 0 without walls [m]
LX = 24  # lowest node of the box, x [cells from the object's centre]
LY = 25  # lowest node of the box, y [cells]
LZ = 26  # lowest node of the box, z [cells]
ROOM = 27  # how far a particle may move before the grid is laid out again [m]
MAX_SPEED = 28  # speed above which a particle is a fault [m/s]
TURN = 29  # square of the turn or stretch in a substep that ends the call [1]
KICK = 30  # time over which forces act in the first substep of the call [s]
PARAMETERS = 31

# Sums over time, one row a thread.
PULL_LOW = 0  # impulse of the lower grip along the axis [N s]
PULL_HIGH = 1  # impulse of the upper grip along the axis [N s]
GRIP_WORK = 2  # work of both grips [J]
DECAYED = 3  # lost to the velocity decay of nodes [J]
PROJECTED = 4  # lost to projections of velocities on particles [J]
VISCOUS = 5  # lost to viscosity [J]
DAMAGED = 6  # freed by damage [J]
RELEASED = 7  # taken along by failed particles [J]
CLAMPED = 8  # particle-substeps whose J was clamped [1]
GRAVITY_WORK = 9  # work of gravity [J]
SUMS = 10
ROW = 32  # numbers kept for a thread, so that no two write to one cache line or to its neighbour

# Peaks of a survey: maxima over particles, one row a thread (see `fracsim.mpm.survey`).
PEAKS = 4

# Faults: kind, particle, substep; each thread keeps its first one.
NO_FAULT, SPEED_FAULT, GRID_FAULT = 0, 1, 2

# Tags of particles: grip + 1 in the lowest two bits (0: lower grip, 1: free, 2: upper grip), EXEMPT from damage above,
# then, in units of EXCESS, the excess of strain that is due to a grip's face (`Boundary.excess`).
FREE, EXEMPT, ABOVE, EXCESS = 1, 4, 8, 1 / 4096
