"""Damage laws, one a file, each of one Taichi function `raw(F, J, onset, crit)`.

It returns a damage in [0, 1] for F, (3, 3), J = det F and the thresholds lambda_onset and lambda_crit. The solver keeps
the running maximum (Eq. 4 of the paper), so that damage never heals, and scales tau by (1 - d). With `LANES = True` it
also computes particles side by side (`fracsim.lanes`). A new law is one file here and one YAML file in conf/fracture.
"""

NEEDED = ("raw",)
"""What a module must have."""
