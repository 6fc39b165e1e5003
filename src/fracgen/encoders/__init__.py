"""Encoders of the caption and of the object's picture; both run once a data set, and their outputs are cached."""

from fracgen.config.model import Encoders
from fracgen.encoders.captions import TOKENS, TextEncoder, pad, text, text_identity
from fracgen.encoders.clip import ImageEncoder, image, image_identity

__all__ = ["TOKENS", "ImageEncoder", "TextEncoder", "identity_of", "image", "image_identity", "pad", "text",
           "text_identity"]  # fmt: skip


def identity_of(cfg: Encoders, dim: int) -> dict[str, str]:
    """The identities of both encoders, "text" and "image", without loading either.

    Raises ValueError for weights that are missing.
    """
    return {"text": text_identity(cfg, dim), "image": image_identity(cfg)}
