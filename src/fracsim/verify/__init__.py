"""Problems with known answers for the solver; `python -m fracsim.verify` runs them.

A problem is one module of `fracsim.verify.problems`: its exact solution as NumPy functions and
`run(setting) -> Iterator[Check]`. One that makes sense in one formulation only says so in `FORMULATIONS`.
"""
