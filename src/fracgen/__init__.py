"""Generate videos of objects that are pulled until they tear, with aligned physics maps, from one picture."""

from fracsim.version import __version__

__all__ = ["__version__"]
