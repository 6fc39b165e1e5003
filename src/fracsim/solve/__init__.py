"""From particles to frames: time stepping, fragments, failed particles, and the report of a run."""
