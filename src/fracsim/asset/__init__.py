"""Objects as particles: built-in objects, surface meshes and trained Gaussians; `build` is the entry."""
