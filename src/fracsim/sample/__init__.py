"""The sample on disk: one folder with colour, maps, tracks and everything needed to make it again; no Taichi here.

`sample = read("outputs/1a2b3c4d5e6f")` opens one: `sample.rgb`, `sample.maps["stress"]`, `sample.tracks.xy`.
"""

from fracsim.sample.folder import find
from fracsim.sample.reader import Maps, Sample, Tracks, read, verify
from fracsim.sample.schema import sample_id
from fracsim.sample.writer import Writer

__all__ = ["Maps", "Sample", "Tracks", "Writer", "find", "read", "sample_id", "verify"]
