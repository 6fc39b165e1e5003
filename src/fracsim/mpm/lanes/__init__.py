"""The substep of `total` on a CPU: the particles of eight cells side by side, a cell a lane (`fracsim.lanes`).

`groups` says which cells, `transfer` moves numbers between nodes and lanes, `cell` is what a group of cells does in a
substep, `kernels` drives all groups, and `side_by_side` holds their arrays.
"""
