"""The video autoencoder of Wan2.1: 1 + 4 n frames of 8 h x 8 w pixels are 1 + n latent frames of 16 x h x w."""

from fracgen.vae.frozen import FrozenVae, identity_of, load
from fracgen.vae.network import build

__all__ = ["FrozenVae", "build", "identity_of", "load"]
