"""Deformed Gaussians to pictures: camera, projection, tiles, compositing; `splat` is the host that calls them."""
