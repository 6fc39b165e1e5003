"""Inputs at and beyond the edge of what is allowed: each gives finite numbers, or is refused by name."""
