"""Encoders of the caption and of the object's picture; both run once a data set, and their outputs are cached."""

from fracgen.encoders.image import ImageEncoder, image, image_identity
from fracgen.encoders.text import TOKENS, TextEncoder, pad, text, text_identity

__all__ = ["TOKENS", "ImageEncoder", "TextEncoder", "image", "image_identity", "pad", "text", "text_identity"]
