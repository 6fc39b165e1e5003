"""The material point method at substep rate: Taichi functions and kernels, and the arrays they work on."""
