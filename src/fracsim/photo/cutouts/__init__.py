"""Ways to find the object in a photo, a module each; also a file ./CUTOUT.py.

Each has `cut(photo) -> mask`, (H, W) bool, True on the object. It raises ValueError for a photo it cannot cut, and
ImportError where a library is missing. A network such as Segment Anything is a file of a few lines: load it, call it
with `photo.rgb`, return its mask.
"""

NEEDED = ("cut",)
