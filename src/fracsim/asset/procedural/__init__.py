"""Tools for the built-in objects, in pure NumPy: distances of solids, noise, textures and baked light."""
