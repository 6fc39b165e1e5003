"""From a data set of clips to batches of latents: encoded once, read without VAE and encoders.

    cache = fracgen.data.open("latents")
    clip = cache[0]                                # a Batch without the batch dimension
    batch = fracgen.data.collate([cache[0], cache[1]])

`python -m fracgen.encode` writes a cache, `fracgen.data.DataModule` feeds a trainer from one.
"""

from typing import TYPE_CHECKING, Any

from fracgen.data.batch import Batch
from fracgen.data.cache import LatentCache, Place, collate, open

if TYPE_CHECKING:
    from fracgen.data.module import DataModule

__all__ = ["Batch", "DataModule", "LatentCache", "Place", "collate", "open"]


def __getattr__(name: str) -> Any:
    """Import Lightning, which takes seconds, only where DataModule is used: a process that reads does without."""
    if name == "DataModule":
        from fracgen.data.module import DataModule

        return DataModule
    raise AttributeError(f"module {__name__} has no attribute {name}")
