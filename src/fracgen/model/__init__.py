"""The video transformer and its weights."""

from fracgen.model.base import base_identity, build, empty
from fracgen.model.transformer import FracTransformer

__all__ = ["FracTransformer", "base_identity", "build", "empty"]
