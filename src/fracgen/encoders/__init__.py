"""Encoders of the caption and of the object's picture; both run once a data set, and their outputs are cached."""

from fracgen.encoders.captions import TOKENS, TextEncoder, pad, text, text_identity
from fracgen.encoders.clip import ImageEncoder, image, image_identity

__all__ = ["TOKENS", "ImageEncoder", "TextEncoder", "image", "image_identity", "pad", "text", "text_identity"]
