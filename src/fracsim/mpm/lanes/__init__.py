"""The substep of `total` on a CPU: the particles of eight cells side by side, a cell a lane (`fracsim.lanes`).

`groups` says which cells, `record` where their numbers lie, `transfer` moves numbers between nodes and lanes, `cell` is
what a group of cells does in a substep, `damaging` how their damage grows, `kernels` drives all groups, and
`side_by_side` holds their arrays.
"""
