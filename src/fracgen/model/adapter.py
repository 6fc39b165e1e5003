"""What is trained of the transformer: low-rank adapters (LoRA, Hu et al. 2022) on a frozen base, or all of it."""

import warnings
from collections.abc import Iterator
from typing import Any

import torch
from peft import LoraConfig
from torch import Tensor, nn
from torch.nn.utils import parametrize

from fracgen.conditioning import SCALARS
from fracgen.config.model import Lora, Model
from fracgen.layout import CHANNELS
from fracgen.model.transformer import FracTransformer

ADAPTER = "default"
"""Name of the adapter that is trained."""
FIRST = 2 * CHANNELS
"""First of the scalar channels in the input of the network: they follow the noisy latent and the force latent."""


def prepare(transformer: FracTransformer, cfg: Model) -> None:
    """Freeze what is not trained and add what is; what is trained becomes float32, the rest keeps its type.

    `cfg.train` = lora: adapters that change nothing yet, the layer of the condition channels as
    `cfg.train_patch_embed` says, and the embedding of the maps where there is one. full: all weights.
    Raises ValueError for a target that names no linear layer, and for new_channels where all weights are trained.
    """
    full = cfg.train == "full"
    if full and cfg.train_patch_embed == "new_channels":
        raise ValueError("model.train_patch_embed=new_channels is not allowed with model.train=full, which trains all "
                         "channels: set model.train_patch_embed=none or model.train=lora.")  # fmt: skip
    transformer.requires_grad_(full)
    if not full:
        with torch.random.fork_rng(devices=[]):  # every process starts from the same adapter
            torch.manual_seed(cfg.seed)
            add(transformer, cfg.lora)
        _patch_embed(transformer.patch_embedding, cfg.train_patch_embed)
        if transformer.map_embed is not None:
            transformer.map_embed.requires_grad_(True)
    for _, parameter in trained(transformer):
        parameter.data = parameter.data.float()


def add(transformer: FracTransformer, lora: Lora, name: str = ADAPTER) -> None:
    """Add an adapter that changes nothing yet, and make it the active one; raises ValueError for an idle target."""
    linears = [n.removesuffix(".base_layer") for n, m in transformer.named_modules() if isinstance(m, nn.Linear)]
    for target in lora.targets:
        if not any(f".{linear}".endswith(f".{target}") for linear in linears):
            raise ValueError(f"model.lora.targets={lora.targets}: {target} names no linear layer of the transformer; "
                             "its layers end in to_q, to_k, to_v, to_out.0, ffn.net.0.proj, ffn.net.2.")  # fmt: skip
    kind: Any = LoraConfig  # its alpha need not be whole
    config = kind(r=lora.rank, lora_alpha=lora.alpha, target_modules=list(lora.targets))
    inject(transformer, config, name)


def inject(transformer: FracTransformer, config: LoraConfig, name: str) -> None:
    """Add the layers of an adapter and make it the only active one, without peft's warning of a second adapter."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Already found a `peft_config`")
        transformer.add_adapter(config, adapter_name=name)


def trained(transformer: nn.Module) -> Iterator[tuple[str, nn.Parameter]]:
    """Names and parameters that are trained."""
    return ((name, p) for name, p in transformer.named_parameters() if p.requires_grad)


def norms(transformer: nn.Module, name: str = ADAPTER) -> dict[str, float]:
    """Frobenius norm of lora_B of every layer with the adapter `name`, by layer; 0 for one that changes nothing."""
    ending = f".lora_B.{name}.weight"
    factors = {n.removesuffix(ending): p for n, p in transformer.named_parameters() if n.endswith(ending)}
    values = torch.stack([p.detach().float().norm() for p in factors.values()]).tolist() if factors else []
    return dict(zip(factors, values, strict=True))


def is_zero(transformer: nn.Module, name: str = ADAPTER) -> bool:
    """Whether the adapter `name` changes nothing, as a new one, one that was not trained, or none at all."""
    return not any(norms(transformer, name).values())


class Channels(nn.Module):
    """Some input channels of a convolution as parameters of their own; the others cannot move.

    A mask on the gradient would leave the others to weight decay, which moves a parameter without any gradient. Here
    the optimiser does not have them.
    """

    def __init__(self, weight: Tensor, first: int, count: int) -> None:
        super().__init__()
        self.span = slice(first, first + count)
        self.channels = nn.Parameter(weight.detach()[:, self.span].clone())

    def forward(self, weight: Tensor) -> Tensor:
        """The whole weight, [out, in, ...], from the frozen one of that shape."""
        before, after = weight[:, : self.span.start], weight[:, self.span.stop :]
        return torch.cat([before, self.channels.to(weight), after], dim=1)


def _patch_embed(layer: nn.Module, choice: str) -> None:
    """Train nothing, everything, or the scalar channels of the layer that reads the network's input."""
    layer.requires_grad_(choice == "full")
    if choice == "new_channels":
        assert isinstance(layer.weight, Tensor)
        parametrize.register_parametrization(layer, "weight", Channels(layer.weight, FIRST, len(SCALARS)))
