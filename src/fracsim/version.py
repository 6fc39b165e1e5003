"""The version of fracsim."""

__version__ = "0.1.0"
