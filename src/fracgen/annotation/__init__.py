"""The annotation page: one photo, two grips, a material; its previews, its simulation, and its condition file."""
