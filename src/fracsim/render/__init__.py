"""Deformed Gaussians to pictures: projection, tiles, compositing. `splat` calls them, `film` films a simulation."""
