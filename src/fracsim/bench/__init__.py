"""What fracsim costs: `python -m fracsim.bench` measures, prints and stores it.

Each measurement runs in a process of its own, so that Taichi can start with one thread or with all of them, and
nothing that was imported or compiled for one is there for another. Kernels are compiled before they are timed, and
competitors take turns, so that a machine that slows down slows all of them down.
"""
