"""Names of the VAE's tensors in the released file (`Wan2.1_VAE.pth`), and in diffusers."""

import re
from collections.abc import Iterable

_RESIDUAL = {"norm1": "residual.0", "conv1": "residual.2", "norm2": "residual.3", "conv2": "residual.6",
             "conv_shortcut": "shortcut"}  # fmt: skip
"""Parts of a residual block."""
_MIDDLE = {"resnets.0": "middle.0", "attentions.0": "middle.1", "resnets.1": "middle.2"}
"""Parts of the block at the lowest resolution."""
_ENDS = {"conv_in": "conv1", "norm_out": "head.0", "conv_out": "head.2"}
"""First and last layers of encoder and decoder."""
_WHOLE = {"quant_conv": "conv1", "post_quant_conv": "conv2"}
"""Layers around the latent."""


def released(name: str, res_blocks: int) -> str:
    """The released name of a tensor that diffusers calls `name`, in a network of `res_blocks` residual blocks."""
    part, _, rest = name.partition(".")
    if part in _WHOLE:
        return f"{_WHOLE[part]}.{rest}"
    head, _, tail = rest.partition(".")
    if head in _ENDS:
        return f"{part}.{_ENDS[head]}.{tail}"
    if head == "mid_block":
        kind, number, tail = tail.split(".", 2)
        return f"{part}.{_MIDDLE[f'{kind}.{number}']}.{_inside(tail)}"
    if head == "down_blocks":
        return f"{part}.downsamples.{_inside(tail)}"
    # Blocks of the decoder are counted through: res_blocks + 1 residual ones and one that enlarges.
    block, kind, number, tail = tail.split(".", 3)
    within = int(number) if kind == "resnets" else res_blocks + 1
    return f"{part}.upsamples.{int(block) * (res_blocks + 2) + within}.{_inside(tail)}"


def _inside(name: str) -> str:
    """A name below a block, with the parts of a residual block renamed; the other blocks have equal names."""
    return re.sub(r"\b(norm[12]|conv[12]|conv_shortcut)\b", lambda found: _RESIDUAL[found[0]], name, count=1)


def table(names: Iterable[str], res_blocks: int) -> dict[str, str]:
    """Diffusers' names by the released ones, for all `names` of a network."""
    return {released(name, res_blocks): name for name in names}
