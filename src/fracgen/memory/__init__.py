"""Memory and speed of the transformer in training: each choice of `fracgen.config.train.Trainer` is a module here.

The order in which they go together: adapter.prepare, quantise, checkpointing, offload while on the CPU; then, on the
device, context parallelism, attention, and compilation, which does not go with offload.
"""
