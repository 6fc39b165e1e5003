"""The built-in objects, one module each: `distance`, `colour`, `BOUNDS` and `CLASS`, in pure NumPy.

Object coordinates: x right, y up, seen from +z looking along -z; the largest extent is about 1 (the bar's is 0.6).
`distance(P: [N, 3]) -> [N]` is negative inside; `colour(P: [N, 3], depth: [N]) -> [N, 3]` is sRGB in [0, 1], `depth`
being the distance below the surface in object units; `BOUNDS` is an axis-aligned box that holds the surface.
"""

import pkgutil

HELPERS = frozenset({"noise", "shading", "shapes", "texture"})


def names() -> tuple[str, ...]:
    """Names of the built-in objects, sorted, found among the modules of this folder."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if m.name not in HELPERS))
