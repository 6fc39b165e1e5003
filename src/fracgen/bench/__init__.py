"""Measurements of the generator: time of a step, reading of clips, memory against its plan."""
