"""Measurements of time and memory: `python -m fracsim.bench` measures, prints and stores them.

Each measurement runs in its own process, so that Taichi can start with one thread or with all of them, and no
measurement profits from the imports or kernels of another. Kernels are compiled before they are timed. Competitors take
turns, so that a change of the machine's speed affects all of them.
"""
