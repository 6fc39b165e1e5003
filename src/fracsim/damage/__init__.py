"""Damage laws, one a file, each the Taichi function `raw(F, J, onset, crit)` in [0, 1], with J = det F.

The solver keeps the running maximum (Eq. 4 of the paper), so that damage never heals, and scales tau by (1 - d).
A new law is one file here and one YAML file in conf/fracture.
"""
