"""Names of the transformer's tensors in the released checkpoint and in diffusers, both ways."""

ATTENTION = {
    "q": "to_q", "k": "to_k", "v": "to_v", "o": "to_out.0", "norm_q": "norm_q", "norm_k": "norm_k",
    "k_img": "add_k_proj", "v_img": "add_v_proj", "norm_k_img": "norm_added_k",
}  # fmt: skip
BLOCK = {
    "modulation": "scale_shift_table",
    "norm3": "norm2",  # the one norm with weights stands before cross attention
    "ffn.0": "ffn.net.0.proj",
    "ffn.2": "ffn.net.2",
    **{f"self_attn.{ours}": f"attn1.{theirs}" for ours, theirs in ATTENTION.items()},
    **{f"cross_attn.{ours}": f"attn2.{theirs}" for ours, theirs in ATTENTION.items()},
}
"""Inside a block, released name to diffusers name."""
OUTSIDE = {
    "text_embedding.0": "condition_embedder.text_embedder.linear_1",
    "text_embedding.2": "condition_embedder.text_embedder.linear_2",
    "time_embedding.0": "condition_embedder.time_embedder.linear_1",
    "time_embedding.2": "condition_embedder.time_embedder.linear_2",
    "time_projection.1": "condition_embedder.time_proj",
    "img_emb.proj.0": "condition_embedder.image_embedder.norm1",
    "img_emb.proj.1": "condition_embedder.image_embedder.ff.net.0.proj",
    "img_emb.proj.3": "condition_embedder.image_embedder.ff.net.2",
    "img_emb.proj.4": "condition_embedder.image_embedder.norm2",
    "head.modulation": "scale_shift_table",
    "head.head": "proj_out",
}
"""Outside the blocks; `patch_embedding`, `ref_conv` and our `map_embed` have one name in both."""


def to_diffusers(name: str) -> str:
    """The name in diffusers of a tensor, or module, of the released checkpoint; a name without a rule stays."""
    return _rename(name, BLOCK, OUTSIDE)


def to_released(name: str) -> str:
    """The name in the released checkpoint of a tensor, or module, of diffusers; a name without a rule stays."""
    return _rename(name, *({theirs: ours for ours, theirs in rules.items()} for rules in (BLOCK, OUTSIDE)))


def _rename(name: str, block: dict[str, str], outside: dict[str, str]) -> str:
    """`name` with its module renamed: blocks.N.MODULE.weight by `block`, MODULE.weight by `outside`."""
    prefix, rules = "", outside
    if name.startswith("blocks."):
        _, number, name = name.split(".", 2)
        prefix, rules = f"blocks.{number}.", block
    module, dot, leaf = name.rpartition(".")
    if leaf not in ("weight", "bias"):
        module, dot, leaf = name, "", ""
    return prefix + rules.get(module, module) + dot + leaf
