"""Photos of objects in the wild, pulled by the simulator and by the generator, side by side."""
