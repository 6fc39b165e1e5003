"""The size of what the network sees in one forward pass."""

from dataclasses import dataclass
from typing import NamedTuple

from fracgen.layout import PATCH, latent_frames, latent_size

TEXT_TOKENS, IMAGE_TOKENS = 512, 257
"""Tokens of a caption, zeros after its end, and of the CLIP embedding of the object's picture."""


class Clips(NamedTuple):
    """The clips of a training."""

    width: int
    """[px]"""
    height: int
    """[px]"""
    frames: int
    number: int = 1
    """How many there are."""

    def size(self, streams: int, batch: int = 1) -> "Size":
        """The size of a batch of them."""
        return Size(self.width, self.height, self.frames, streams, batch)


@dataclass(frozen=True)
class Size:
    """`batch` clips of `frames` pictures of `width` x `height` px, with `streams` of them one below the other.

    Raises ValueError for frames, width or height that the layout does not allow.
    """

    width: int
    height: int
    frames: int
    streams: int = 1
    batch: int = 1

    def __post_init__(self) -> None:
        latent_size(self.width, self.height)
        latent_frames(self.frames)

    @property
    def latent(self) -> tuple[int, int, int]:
        """Latent frames, joint rows and columns (T, S H, W)."""
        columns, rows = latent_size(self.width, self.height)
        return latent_frames(self.frames), self.streams * rows, columns

    @property
    def reference_tokens(self) -> int:
        """Tokens of the object's picture: as many as a latent frame has."""
        _, rows, columns = self.latent
        return rows // PATCH * (columns // PATCH)

    @property
    def video_tokens(self) -> int:
        """Tokens of the noisy video."""
        return self.latent[0] * self.reference_tokens

    @property
    def tokens(self) -> int:
        """Tokens of a clip in self-attention."""
        return self.video_tokens + self.reference_tokens
