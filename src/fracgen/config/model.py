"""The networks: transformer, VAE, encoders of the caption and of the object's picture."""

from dataclasses import dataclass, field

from fracsim.scene.knob import check, knob


@dataclass(kw_only=True)
class Lora:
    """Low-rank adapters on query, key, value, output and feed-forward of every block."""

    rank: int = knob(64, "rank of an update", least=1, most=4096)
    alpha: float = knob(
        64.0, "its scale times the rank; the paper's base recipe has alpha = rank", least=0, open="least"
    )
    targets: list[str] = knob(["to_q", "to_k", "to_v", "to_out.0", "ffn.net.0.proj", "ffn.net.2"],
                              "linear layers with an adapter, by the ends of their names")  # fmt: skip

    def __post_init__(self) -> None:
        check(self, "model.lora")
        if not self.targets:
            raise ValueError("model.lora.targets=[] leaves nothing to train: name layers, as [to_q,to_v].")


@dataclass(kw_only=True)
class Model:
    """The video transformer."""

    path: str = knob("", "folder of its weights, in released or diffusers layout; empty = random weights")
    hub: bool = knob(False, "path is a name on the hub, to be downloaded if need be")
    layers: int = knob(30, "transformer blocks", least=1, most=1000)
    heads: int = knob(12, "attention heads", least=1, most=1000)
    head_dim: int = knob(128, "channels of a head", least=8, most=1024)
    ffn_dim: int = knob(8960, "channels between the two layers of the feed-forward", least=1)
    text_dim: int = knob(4096, "channels of the caption's embedding", least=1)
    image_dim: int = knob(1280, "channels of the CLIP embedding of the object's picture; 0 = no such branch", least=0)
    rope: str = knob("continuous", "rows of the joint latent: continuous counts on from map to map; shared gives every "
                     "map the rows of the picture, and a learned embedding that tells maps apart",
                     choices=("continuous", "shared"))  # fmt: skip
    train: str = knob("lora", "what is trained: adapters, or all weights", choices=("lora", "full"))
    train_patch_embed: str = knob("none", "train the layer that reads the condition channels too: not at all (the "
                                  "paper), all of it, or the six scalar channels only",
                                  choices=("none", "full", "new_channels"))  # fmt: skip
    seed: int = knob(0, "seed of random weights", least=0, most=2**31 - 1)
    lora: Lora = field(default_factory=Lora)

    def __post_init__(self) -> None:
        check(self, "model")
        if self.head_dim % 2:
            raise ValueError(f"model.head_dim={self.head_dim} must be even: rotary embeddings turn pairs of channels.")


@dataclass(kw_only=True)
class Vae:
    """The video autoencoder: 4 frames and 8 x 8 pixels a latent of 16 channels; frozen but in fracgen.train_vae."""

    path: str = knob("", "folder or file of its weights, in released or diffusers layout; empty = random weights")
    hub: bool = knob(False, "path is a name on the hub, to be downloaded if need be")
    kind: str = knob("wan", "wan: that of Wan2.1; patch: a cheap one with the same latents, which codes patches of 4 x "
                     "8 x 8 pixels", choices=("wan", "patch"))  # fmt: skip
    base_dim: int = knob(96, "channels at full resolution (kind=patch: of all layers)", least=4, most=1024)
    dim_mult: list[int] = knob([1, 2, 4, 4], "channels at each of the four resolutions, times base_dim (kind=wan)",
                               least=1)  # fmt: skip
    res_blocks: int = knob(2, "residual blocks at each resolution", least=1, most=16)
    tile: int = knob(0, "edge of tiles that are decoded one by one, to save memory; 0 = no tiles", "px", least=0)
    dtype: str = knob("float32", "floating-point type", choices=("float32", "bfloat16", "float16"))
    seed: int = knob(0, "seed of random weights", least=0, most=2**31 - 1)

    def __post_init__(self) -> None:
        check(self, "vae")
        if len(self.dim_mult) != 4:
            raise ValueError(f"vae.dim_mult={self.dim_mult} must have four numbers, so that 8 x 8 pixels are a latent.")
        if self.tile % 32:
            raise ValueError(f"vae.tile={self.tile} must be a multiple of 32, as 256, or 0.")


@dataclass(kw_only=True)
class Encoders:
    """Encoders of the caption and of the object's picture; their outputs are cached, so that training needs neither."""

    text: str = knob("umt5", "umt5: the released encoder; words: a fixed random vector a word, without weights",
                     choices=("umt5", "words"))  # fmt: skip
    text_path: str = knob("", "folder of UMT5 with its tokenizer, or of the released model (text=umt5)")
    image: str = knob("clip", "clip: the released ViT-H/14; zeros: no embedding, as the base was trained on 10 % of "
                      "its clips", choices=("clip", "zeros"))  # fmt: skip
    image_path: str = knob("", "file or folder of CLIP, or of the released model (image=clip)")

    def __post_init__(self) -> None:
        check(self, "encoders")
