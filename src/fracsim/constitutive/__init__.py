"""Hyperelastic laws, one a file, each of four Taichi functions. F, cof and P are (3, 3), l is (3,).

`psi(F, theta, mu, lam)`  strain energy density [Pa]: a part for the change of shape, and lam times a function of the
    volume ratio theta. theta is det F or its mean over a cell (`fracsim.mpm.dilatation`).
`piola(F, cof, J, theta, mu, lam)`  first Piola-Kirchhoff stress P = dpsi/dF + dpsi/dtheta cof F [Pa]. The caller gives
    cof = cof F = J F^-T and J = det F. The Kirchhoff stress is tau = P F^T.
`bound_total(l, J, theta, mu, lam)`  upper bound of the largest eigenvalue of dP/dF [Pa] at principal stretches l1 >= l2
    >= l3: the stiffness seen by a grid in the rest configuration.
`bound_updated(l, J, mu, lam)`  the same for dtau / d(ln stretch): the stiffness seen by a grid in the present
    configuration.

With `LANES = True` the functions also compute particles side by side: see `fracsim.lanes` for what differs.

A new law is one file here and one YAML file in conf/material. `tests/sim/test_constitutive.py` finds it and checks
psi(I) = 0, objectivity, symmetry, P = dpsi/dF, Hooke's law at small strain, and that the bounds hold.
"""

NEEDED = ("psi", "piola", "bound_total", "bound_updated")
"""What a module must have."""
