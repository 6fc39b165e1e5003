"""A photograph of an object: its pixels, the object's outline in it, and where both lie in the world.

Without Taichi and without networks; the annotation page uses it too.
"""

from fracsim.photo.cutting import cut
from fracsim.photo.reading import Photo, load

__all__ = ["Photo", "cut", "load"]
