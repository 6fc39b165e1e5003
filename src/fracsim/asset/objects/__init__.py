"""The built-in objects, one module each: `distance`, `colour`, `BOUNDS` and `CLASS`, in pure NumPy.

Object coordinates: x right, y up, seen from +z looking along -z; the largest extent is about 1 (the bar's is 0.6).
`distance(P)`, (N,), of points P, (N, 3), is negative inside. `colour(P, depth)`, (N, 3), is sRGB in [0, 1] at depths,
(N,), below the surface in object units. `BOUNDS` is an axis-aligned box around the surface. `CLASS` is the class of the
paper, low_stretch or high_stretch. Private functions take points as rows, P, Q or V of shape (3, N).

A new object is one file here and one YAML file in conf/asset. `tests/asset/test_objects.py` finds it and checks it.
"""
