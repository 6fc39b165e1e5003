"""Problems with known answers for the solver; `python -m fracsim.verify` runs them.

A problem is one module of `fracsim.verify.problems`: its exact solution as NumPy functions, and
`run(setting) -> Iterator[Check]`. `FORMULATIONS` names the formulations of a problem that does not suit both.
"""
