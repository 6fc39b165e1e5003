"""Rotary position embedding (Su et al. 2021) of a joint latent: time, row and column turn their own channels."""

from diffusers.models.transformers.transformer_wan import WanRotaryPosEmbed
from torch import Tensor

from fracgen.layout import PATCH

LENGTH = 1024
"""Positions of an axis that have an angle; a longer clip or a higher joint latent has none."""


class JointRope(WanRotaryPosEmbed):
    """Angles of S streams, whose rows count on (continuous) or begin at 0 again in every map (shared).

    It is one module with one output for all tokens, so that diffusers' context parallelism can split it.
    """

    def __init__(self, head_dim: int, streams: int, mode: str) -> None:
        super().__init__(head_dim, (1, PATCH, PATCH), LENGTH)
        self.repeats = streams if mode == "shared" else 1

    def forward(self, latent: Tensor, extra: int = 0) -> tuple[Tensor, Tensor]:  # type: ignore[override]
        """Cosines and sines of all tokens, [1, L, 1, D] each, of a latent [B, C, T, S H, W]; L = (T + extra) S H W / 4.

        `extra` frames come first, so that with a reference its tokens have time 0 and the clip has times 1 to T.
        """
        b, c, t, h, w = latent.shape
        shape = latent.new_empty(1).expand(b, c, t + extra, h // self.repeats, w)  # only its shape is read
        cos, sin = super().forward(shape)
        return self._repeat(cos, t + extra), self._repeat(sin, t + extra)

    def _repeat(self, angles: Tensor, frames: int) -> Tensor:
        """Angles of one picture's rows, [1, T h w, 1, D], for each of the streams of a frame, [1, T S h w, 1, D]."""
        one = angles.reshape(1, frames, 1, -1, *angles.shape[2:])
        return one.expand(-1, -1, self.repeats, -1, -1, -1).flatten(1, 3)
