"""The sample on disk: one folder with colour, maps, tracks and everything needed to make it again; no Taichi here.

`sample = read("outputs/1a2b3c4d5e6f")` opens one: `sample.rgb`, `sample.maps["stress"]`, `sample.read("rgb", 17, 34)`.
A pixel of `maps` holds the quantity times its coverage; `sample.maps_over_alpha["stress"]` is the quantity itself.
`Writer(header, output)` writes one, for any producer; `header_of(scene)` is the header of a simulated sample.
"""

from fracsim.sample.folder import find
from fracsim.sample.header import Header, MapInfo, header_of, map_infos
from fracsim.sample.identity import sample_id, scene_content, scene_id
from fracsim.sample.reader import Maps, Sample, Tracks, read, verify
from fracsim.sample.writer import Writer

__all__ = ["Header", "MapInfo", "Maps", "Sample", "Tracks", "Writer", "find", "header_of", "map_infos", "read",
           "sample_id", "scene_content", "scene_id", "verify"]  # fmt: skip
