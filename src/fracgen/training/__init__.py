"""Training: the Lightning module that wires the parts, the stages, the folders of runs, callbacks and loggers."""
