"""The video transformer: Wan2.1-Fun-V1.1-1.3B-Control as a subclass of diffusers' Wan transformer.

Sources: Wan (Wan Team 2025, arXiv 2503.20314); VideoX-Fun for the reference tokens and the 48 input channels. Shapes:
B clips, T latent frames, S streams of H x W latent rows and columns, one below the other; D channels of the network.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from diffusers.configuration_utils import register_to_config
from diffusers.models.modeling_outputs import Transformer2DModelOutput
from diffusers.models.transformers.transformer_wan import WanTransformer3DModel
from torch import Tensor, nn

from fracgen.conditioning import CONDITION_CHANNELS
from fracgen.layout import CHANNELS, PATCH, RGB, STREAMS, ordered
from fracgen.model.context import IMAGE_TOKENS, TEXT_TOKENS, Kept, reused
from fracgen.model.rope import LENGTH, JointRope

IN_CHANNELS = CHANNELS + CONDITION_CHANNELS
"""The noisy latent, then the condition channels."""


class FracTransformer(WanTransformer3DModel):
    """A `fracgen.denoiser.Network`: Wan's transformer that also reads a reference picture and knows its streams.

    The reference's latent becomes tokens of an own convolution, which stand before those of the clip, with time 0
    and the usual rows and columns; they are cut off behind the head. Their keys and values cannot be kept from one
    sampling step to the next: they attend to the noisy clip and are modulated by the timestep, so they change.

    Names of submodules are those of diffusers, so that its adapters, attention back-ends, compilation of blocks,
    gradient checkpointing and context parallelism find them. Parameters in `_keep_in_fp32_modules` stay float32.
    """

    _keep_in_fp32_modules = WanTransformer3DModel._keep_in_fp32_modules + ["map_embed"]
    _skip_layerwise_casting_patterns = WanTransformer3DModel._skip_layerwise_casting_patterns + ["ref_conv"]

    @register_to_config  # type: ignore[untyped-decorator]
    def __init__(
        self,
        streams: Sequence[str] = (RGB,),
        rope_mode: str = "continuous",
        num_attention_heads: int = 12,
        attention_head_dim: int = 128,
        ffn_dim: int = 8960,
        num_layers: int = 30,
        text_dim: int = 4096,
        image_dim: int | None = 1280,
    ) -> None:
        """Random weights, float32; `rope_mode` is "continuous" or "shared"; no CLIP branch if `image_dim` is None.

        Raises ValueError for unknown streams.
        """
        dim = num_attention_heads * attention_head_dim
        super().__init__(
            patch_size=(1, PATCH, PATCH), num_attention_heads=num_attention_heads,
            attention_head_dim=attention_head_dim, in_channels=IN_CHANNELS, out_channels=CHANNELS, text_dim=text_dim,
            ffn_dim=ffn_dim, num_layers=num_layers, image_dim=image_dim,
            added_kv_proj_dim=None if image_dim is None else dim, rope_max_seq_len=LENGTH,
        )  # fmt: skip
        self.streams = ordered(streams)
        self.kept: Kept | None = None
        self.image_dim = image_dim
        self.rope = JointRope(attention_head_dim, len(self.streams), rope_mode)
        self.ref_conv = nn.Conv2d(CHANNELS, dim, kernel_size=PATCH, stride=PATCH)
        self.map_embed = nn.Parameter(torch.zeros(len(STREAMS), dim)) if rope_mode == "shared" else None

    def forward(
        self,
        hidden_states: Tensor,
        timestep: Tensor,
        encoder_hidden_states: Tensor,
        encoder_hidden_states_image: Tensor | None = None,
        reference: Tensor | None = None,
        return_dict: bool = True,
    ) -> tuple[Tensor] | Transformer2DModelOutput:
        """The predicted velocity, [B, 16, T, S H, W], in the dtype of `hidden_states`.

        `hidden_states` [B, 48, T, S H, W]: the noisy latent and the condition channels. `timestep` [B] float, 1000
        sigma. `encoder_hidden_states` [B, 512, text_dim], zeros after the caption's end. `encoder_hidden_states_image`
        [B, 257, image_dim]: None stands for zeros, and must be None without the CLIP branch. `reference`
        [B, 16, S H, W]: zeros where there is none, as in the training of the base; None leaves its tokens out, which
        is plain Wan. Raises ValueError for shapes that do not fit.
        """
        self._check(hidden_states, encoder_hidden_states, encoder_hidden_states_image, reference)
        rotary = self.rope(hidden_states, extra=0 if reference is None else 1)
        tokens = self._tokens(hidden_states, reference)
        temb, modulation = self._time(timestep, tokens.dtype)
        context = self._reused_context(encoder_hidden_states, encoder_hidden_states_image, tokens.dtype)
        checkpoint: Any = self._gradient_checkpointing_func
        for block in self.blocks:
            if torch.is_grad_enabled() and self.gradient_checkpointing:
                tokens = checkpoint(block, tokens, context, modulation, rotary)
            else:
                tokens = block(tokens, context, modulation, rotary)
        out = self._unpatchify(self._head(tokens, temb), hidden_states)
        return Transformer2DModelOutput(sample=out) if return_dict else (out,)

    def reuse_context(self) -> AbstractContextManager[None]:
        """Inside `with transformer.reuse_context():` caption and picture are projected once, not in each step.

        For sampling: in eval mode, without gradients; results are equal bit for bit. A caption is known by its tensor,
        so give the same tensor in every step, and do not change it or the weights meanwhile. Every step but the first
        saves 4 D^2 (512 + 257) FLOPs a block, for keys and values, and the embeddings of caption and picture. With the
        released model and 81 frames that is 1.1 % of a step for rgb alone at 256 x 256 pixels, 0.009 % for five streams
        at 512 x 512; with the tiny model and 17 frames of 64 x 64 it is 35 % (counted by
        tests/gen/test_reuse_context.py). A caption takes 142 MB of the released model in bfloat16 while it is kept.
        """
        return reused(self)

    def _reused_context(self, text: Tensor, image: Tensor | None, dtype: torch.dtype) -> Tensor:
        """`_context`, or what it gave for the same tensors within `reuse_context`."""
        if self.kept is None:
            return self._context(text, image, dtype)
        if torch.is_grad_enabled():
            raise ValueError("reuse_context is for sampling: call the transformer under torch.no_grad().")
        return self.kept.get(lambda: self._context(text, image, dtype), text, image)

    def _dtype(self, device: torch.device) -> torch.dtype:
        """Type of the tokens: that of autocast, or of the head's weights, which are neither quantised nor adapted."""
        if _has_autocast(device) and torch.is_autocast_enabled(device.type):
            return torch.get_autocast_dtype(device.type)
        dtype: torch.dtype = self.proj_out.weight.dtype
        return dtype

    def _tokens(self, x: Tensor, reference: Tensor | None) -> Tensor:
        """Tokens of the reference, if any, and of the clip, [B, (1 + T) S H W / 4, D]."""
        frames = self.patch_embedding(x.to(self.patch_embedding.weight.dtype))
        if reference is not None:
            first = self.ref_conv(reference.to(self.ref_conv.weight.dtype))
            frames = torch.cat([first[:, :, None].to(frames), frames], dim=2)
        tokens = frames.flatten(2).transpose(1, 2)
        if self.map_embed is not None:
            rows = [STREAMS.index(name) for name in self.streams]
            per_map = tokens.reshape(len(x), frames.shape[2], len(rows), -1, tokens.shape[-1])
            tokens = (per_map + self.map_embed[rows][:, None]).flatten(1, 3)
        out: Tensor = tokens.to(self._dtype(x.device)).contiguous()
        return out

    def _time(self, timestep: Tensor, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
        """Embedding of the timestep, [B, D] float32, and the blocks' shifts, scales and gates, [B, 6, D]."""
        embed: Any = self.condition_embedder
        device = timestep.device
        with torch.autocast(device.type, enabled=False) if _has_autocast(device) else nullcontext():
            waves = embed.timesteps_proj(timestep.float())
            temb = embed.time_embedder(waves.to(embed.time_embedder.linear_1.weight.dtype)).float()
        return temb, embed.time_proj(embed.act_fn(temb.to(dtype))).reshape(len(temb), 6, -1)

    def _context(self, text: Tensor, image: Tensor | None, dtype: torch.dtype) -> Tensor:
        """What cross attention looks at: tokens of the image, if there is that branch, and of the text."""
        embed: Any = self.condition_embedder
        tokens: Tensor = embed.text_embedder(text.to(dtype))
        if self.image_dim is None:
            return tokens
        if image is None:
            image = text.new_zeros(len(text), IMAGE_TOKENS, self.image_dim)
        picture: Tensor = embed.image_embedder(image.to(dtype))
        return torch.cat([picture, tokens], dim=1)

    def _head(self, tokens: Tensor, temb: Tensor) -> Tensor:
        """Patches of the velocity, [B, L, 4 x 16]."""
        shift, scale = (self.scale_shift_table + temb[:, None]).chunk(2, dim=1)
        out: Tensor = self.proj_out((self.norm_out(tokens.float()) * (1 + scale) + shift).type_as(tokens))
        return out

    @staticmethod
    def _unpatchify(patches: Tensor, like: Tensor) -> Tensor:
        """The latent [B, 16, T, S H, W] of patches [B, L, 4 x 16], those of the reference cut off."""
        b, _, t, h, w = like.shape
        rows, columns = h // PATCH, w // PATCH
        clip = patches[:, -t * rows * columns :].reshape(b, t, rows, columns, PATCH, PATCH, -1)
        return clip.permute(0, 6, 1, 2, 4, 3, 5).flatten(5, 6).flatten(3, 4).to(like.dtype)

    def _check(self, x: Tensor, text: Tensor, image: Tensor | None, reference: Tensor | None) -> None:
        """Raise ValueError, naming the input, unless the shapes fit one another and this network."""
        b, c, _, h, w = x.shape
        streams = len(self.streams)
        if c != IN_CHANNELS:
            raise ValueError(f"hidden_states has {c} channels, {IN_CHANNELS} are needed: {CHANNELS} of the noisy "
                             "latent, then those of fracgen.conditioning.channels.")  # fmt: skip
        if h % (streams * PATCH) or w % PATCH or max(x.shape[2] + 1, h // PATCH, w // PATCH) > LENGTH:
            raise ValueError(f"a joint latent of {h} rows and {w} columns does not fit the {streams} stream(s) "
                             f"{', '.join(self.streams)}: rows must be {streams} times an even number and columns "
                             "even, so that no token straddles two maps, and no axis may have more than "
                             f"{LENGTH} tokens.")  # fmt: skip
        if reference is not None and reference.shape != (b, CHANNELS, h, w):
            raise ValueError(f"reference has shape {tuple(reference.shape)}, {(b, CHANNELS, h, w)} is needed: pad it "
                             "with fracgen.layout.pad_reference.")  # fmt: skip
        if self.image_dim is None and image is not None:
            raise ValueError("image is given, but this network has no CLIP branch (model.image_dim=0): give None.")
        if self.image_dim is not None and text.shape[1] != TEXT_TOKENS:
            raise ValueError(f"text has {text.shape[1]} tokens, {TEXT_TOKENS} are needed, since the network tells text "
                             "and image by their number: pad it with zeros, as fracgen.encoders.pad does.")  # fmt: skip
        if image is not None and image.shape != (b, IMAGE_TOKENS, self.image_dim):
            raise ValueError(f"image has shape {tuple(image.shape)}, {(b, IMAGE_TOKENS, self.image_dim)} is needed: "
                             "the CLIP embedding of one picture a clip.")  # fmt: skip


def _has_autocast(device: torch.device) -> bool:
    """Whether a device knows mixed precision; meta, on which operations are counted, does not."""
    return torch.amp.is_autocast_available(device.type)
