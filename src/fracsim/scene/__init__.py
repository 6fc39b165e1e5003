"""What is simulated, as validated data: the vocabulary of a scene, and the way to it from files. No Taichi here."""
