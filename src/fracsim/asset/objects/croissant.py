"""Croissant: a crescent that faces the viewer, horns down, rolled in seven overlapping segments."""

import numpy as np

from fracsim.asset.procedural import noise, shading, texture
from fracsim.asset.procedural.shapes import Array, hypot, in_blocks, smoothstep

BOUNDS = ((-0.52, -0.41, -0.24), (0.52, 0.50, 0.24))
CLASS = "low_stretch"

CENTRE_Y, RADIUS = -0.09, 0.355  # centre and radius of the roll's circular axis
SPAN = np.deg2rad(132)  # angle from the crown to either tip
THICK, THIN = 0.185, 0.060  # radii of the roll in the middle and at a tip
SEGMENTS = 3.42  # number on each side, half of the middle one included
PALE, GOLD = texture.rgb(0.97, 0.80, 0.46), texture.rgb(0.90, 0.60, 0.24)
BROWN, DARK = texture.rgb(0.69, 0.37, 0.11), texture.rgb(0.47, 0.22, 0.07)
CRUMB, PORE = texture.rgb(0.98, 0.90, 0.68), texture.rgb(0.83, 0.64, 0.36)


@in_blocks()
def distance(P: Array) -> Array:
    """Signed distance (N,) of points (N, 3), negative inside."""
    return _solid(P)


@in_blocks(np.float32)
def colour(P: Array, depth: Array) -> Array:
    """sRGB (N, 3) of points (N, 3) at `depth` (N,) below the surface: baked leaves over a honeycomb crumb."""
    body = texture.coat(P, texture.coating(depth, 0.010, 0.035), _inside, _crust)
    return shading.bake(_solid, P, depth, body, gloss=0.38, sharpness=16)


def _solid(P: Array) -> Array:
    """Distance (N,) of rows (3, N)."""
    off, along, reach = _roll(P)
    ridge = _ridge(_phase(P, along, reach) % 1.0) * (1 - smoothstep(0.85, 0.97, along))
    radius = THICK - (THICK - THIN) * along**1.5
    # Near the circle's centre the angle varies too fast for a distance: there the roll has constant radius, no ridges.
    taper, swell = smoothstep(0.04, 0.18, reach), smoothstep(0.10, 0.26, reach)
    return 0.83 * (off - THICK - taper * (radius - THICK) - swell * ridge)


def _roll(P: Array) -> tuple[Array, Array, Array]:
    """Of rows (3, N): distance (N,) to the centre line, place along it (N,) (0 at the crown, 1 at a tip), and distance
    (N,) from the circle's centre.
    """
    x, y = np.abs(P[0]), P[1] - CENTRE_Y
    angle = np.minimum(np.arctan2(x, y), SPAN)
    u, v = x - RADIUS * np.sin(angle), y - RADIUS * np.cos(angle)
    return np.sqrt(u * u + v * v + P[2] ** 2), angle / SPAN, hypot(x, y)


def _phase(P: Array, along: Array, reach: Array) -> Array:
    """Segments (N,) counted from the crown at rows (3, N), with `along` and `reach` (N,) of `_roll`.

    The seams lean outwards and waver.
    """
    slant = np.clip((reach - RADIUS) / THICK, -1, 1)
    out: Array = 0.5 + SEGMENTS * along + 0.10 * slant * slant + 0.05 * noise.value(P, 7, 11)
    return out


def _ridge(f: Array) -> Array:
    """Height (N,) of the roll's surface at the fraction f (N,) of a segment: it swells, then drops at the lip."""
    return 0.028 * smoothstep(-0.02, 0.6, f) * (1 - smoothstep(0.72, 1.0, f)) - 0.008


def _crust(P: Array) -> Array:
    """Crust colours (3, N) of rows (3, N): browned crests, pale leaves below each lip, fine lines along the seams."""
    _, along, reach = _roll(P)
    phase = _phase(P, along, reach)
    f = phase % 1.0
    leaves = np.sin(2 * np.pi * (6 * phase + 0.8 * noise.value(P, 9, 21)))
    blotch = noise.fractal(P, 8, 22, octaves=3)
    bake = 0.15 + 0.75 * smoothstep(0.05, 0.75, f) * (1 - 0.55 * smoothstep(0.9, 1.0, f)) + 0.22 * blotch
    bake = bake + 0.45 * smoothstep(0.86, 0.97, f) - 0.15 * smoothstep(0.10, 0.0, f)
    bake = bake + 0.12 * leaves * (1 - 0.6 * f) + 0.12 * along
    return texture.marble(texture.ramp(bake, (0.0, 0.35, 0.75, 1.15), (PALE, GOLD, BROWN, DARK)), P, 0.15, 23)


def _inside(P: Array) -> Array:
    """Inner colours (3, N) of rows (3, N): crumb with leaves wound about the roll's centre line."""
    off, along, _ = _roll(P)
    rings = np.sin(2 * np.pi * (off / 0.034 + 0.6 * along + 0.7 * noise.value(P, 10, 31)))
    crumb = texture.crumb(P, CRUMB, PORE, 32, size=1.2)
    return texture.mix(crumb, PORE, 0.38 * smoothstep(0.1, 0.9, rings))
