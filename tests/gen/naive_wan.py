"""Wan with reference tokens, written from its formulas: one clip, float64, tensors under their released names.

No code is shared with what it checks: tokens are cut out by loops, rotary embedding multiplies complex numbers, and
attention is a softmax of a product.
"""

import math
from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn.functional import gelu, silu

Places = list[tuple[int, int, int]]
"""Time, row and column of each token."""


class NaiveWan:
    """Weights `w` by released name; `rows` is the number of token rows after which the rope's rows begin again."""

    def __init__(self, w: Mapping[str, Tensor], heads: int, rows: int) -> None:
        self.w = {name: value.double() for name, value in w.items()}
        self.heads, self.rows = heads, rows
        self.dim = len(self.w["patch_embedding.bias"])
        self.layers = 1 + max(int(name.split(".")[1]) for name in w if name.startswith("blocks."))

    def linear(self, name: str, x: Tensor) -> Tensor:
        return x @ self.w[f"{name}.weight"].flatten(1).T + self.w[f"{name}.bias"]

    def rms(self, name: str, x: Tensor) -> Tensor:
        return x / (x.pow(2).mean(-1, keepdim=True) + 1e-6).sqrt() * self.w[f"{name}.weight"]

    def norm(self, x: Tensor, name: str = "", eps: float = 1e-6) -> Tensor:
        x = x - x.mean(-1, keepdim=True)
        x = x / (x.pow(2).mean(-1, keepdim=True) + eps).sqrt()
        return x * self.w[f"{name}.weight"] + self.w[f"{name}.bias"] if name else x

    def tokens(self, name: str, x: Tensor) -> tuple[Tensor, Places]:
        """Tokens of x [C, T, H, W] and the time, row and column of each."""
        places = [(t, i, j) for t in range(x.shape[1]) for i in range(x.shape[2] // 2) for j in range(x.shape[3] // 2)]
        patches = [x[:, t, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2].flatten() for t, i, j in places]
        return self.linear(name, torch.stack(patches)), places

    def turn(self, x: Tensor, places: Places) -> Tensor:
        """Channels of each head of x [L, D] as complex numbers, turned by time, row and column."""
        size = self.dim // self.heads
        spatial = 2 * (size // 6)
        angles = []
        for t, i, j in places:
            axes = ((t, size - 2 * spatial), (i % self.rows, spatial), (j, spatial))
            angles.append([p * 10000 ** (-2 * k / n) for p, n in axes for k in range(n // 2)])
        turned = torch.polar(torch.ones(1, dtype=torch.float64), torch.tensor(angles, dtype=torch.float64))
        pairs = torch.view_as_complex(x.reshape(len(x), self.heads, size // 2, 2))
        return torch.view_as_real(pairs * turned[:, None]).flatten(1)

    def attend(self, q: Tensor, k: Tensor, v: Tensor) -> Tensor:
        q, k, v = (x.reshape(len(x), self.heads, -1).transpose(0, 1) for x in (q, k, v))
        weights = (q @ k.transpose(1, 2) / math.sqrt(q.shape[-1])).softmax(-1)
        return (weights @ v).transpose(0, 1).flatten(1)

    def block(self, n: int, x: Tensor, places: Places, e: Tensor, text: Tensor, image: Tensor | None) -> Tensor:
        a, c = f"blocks.{n}.self_attn", f"blocks.{n}.cross_attn"
        shift1, scale1, gate1, shift2, scale2, gate2 = (self.w[f"blocks.{n}.modulation"][0] + e).unbind()
        y = self.norm(x) * (1 + scale1) + shift1
        q, k = (self.turn(self.rms(f"{a}.norm_{s}", self.linear(f"{a}.{s}", y)), places) for s in "qk")
        x = x + gate1 * self.linear(f"{a}.o", self.attend(q, k, self.linear(f"{a}.v", y)))
        q = self.rms(f"{c}.norm_q", self.linear(f"{c}.q", self.norm(x, f"blocks.{n}.norm3")))
        k, v = self.rms(f"{c}.norm_k", self.linear(f"{c}.k", text)), self.linear(f"{c}.v", text)
        seen = self.attend(q, k, v)
        if image is not None:
            k, v = self.rms(f"{c}.norm_k_img", self.linear(f"{c}.k_img", image)), self.linear(f"{c}.v_img", image)
            seen = seen + self.attend(q, k, v)
        x = x + self.linear(f"{c}.o", seen)
        y = self.norm(x) * (1 + scale2) + shift2
        y = self.linear(f"blocks.{n}.ffn.2", gelu(self.linear(f"blocks.{n}.ffn.0", y), approximate="tanh"))
        return x + gate2 * y

    def __call__(self, x: Tensor, t: float, text: Tensor, image: Tensor | None, reference: Tensor | None) -> Tensor:
        """The velocity [16, T, H, W] of x [48, T, H, W] at timestep t; text [512, n], image [257, m], one reference."""
        x = x.double()
        tokens, places = self.tokens("patch_embedding", x)
        cut = 0
        if reference is not None:
            first, at = self.tokens("ref_conv", reference.double()[:, None])
            cut, tokens = len(first), torch.cat([first, tokens])
            places = at + [(1 + t, i, j) for t, i, j in places]
        waves = t * 10000 ** (-torch.arange(128, dtype=torch.float64) / 128)
        e = self.linear("time_embedding.0", torch.cat([waves.cos(), waves.sin()]))
        e = self.linear("time_embedding.2", silu(e))
        e6 = self.linear("time_projection.1", silu(e)).reshape(6, -1)
        text = self.linear("text_embedding.2", gelu(self.linear("text_embedding.0", text.double()), approximate="tanh"))
        if image is not None:
            image = self.linear("img_emb.proj.1", self.norm(image.double(), "img_emb.proj.0", eps=1e-5))
            image = self.norm(self.linear("img_emb.proj.3", gelu(image)), "img_emb.proj.4", eps=1e-5)
        for n in range(self.layers):
            tokens = self.block(n, tokens, places, e6, text, image)
        shift, scale = (self.w["head.modulation"][0] + e).unbind()
        patches = self.linear("head.head", self.norm(tokens) * (1 + scale) + shift)[cut:]
        out = torch.empty(16, *x.shape[1:], dtype=torch.float64)
        for patch, (t_, i, j) in zip(patches, places[cut:], strict=True):
            frame = t_ if reference is None else t_ - 1
            out[:, frame, 2 * i : 2 * i + 2, 2 * j : 2 * j + 2] = patch.reshape(2, 2, 16).permute(2, 0, 1)
        return out
