"""What built-in objects are drawn with: distances of solids, noise, textures and baked light, in pure NumPy."""
