"""Scenes as validated data, and the programs that read them from YAML files and the command line. No Taichi here."""
