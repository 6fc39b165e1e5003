"""Many samples as one data set: its plan, its table, reading it, checking it, and copies in formats of others."""
