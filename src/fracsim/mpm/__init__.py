"""The material point method at substep rate: Taichi functions and kernels, and the arrays on which they work.

A `State` is made of a medium, particles, a boundary and a drive, and runs substeps. In the order in which a substep
goes: `kernels` drives `particle` (gather, `damaging`, `dilatation`, `stress`, scatter by `transfer`) and `node`
(`constraint`). `context` lists the arrays; `docs/method.md` has the equations.
"""
