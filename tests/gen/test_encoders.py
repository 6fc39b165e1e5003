"""Encoders of captions and pictures: UMT5 and CLIP in released and transformers layouts, and those without weights."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from fracgen import encoders
from fracgen.config.model import Encoders
from fracgen.encoders import clip, umt5
from tests.command import python

T5_KEYS = Path(__file__).parents[1] / "reference" / "wan_t5_keys.json"
"""Names and shapes of all tensors of models_t5_umt5-xxl-enc-bf16.pth."""
T5 = {"d_model": 24, "d_ff": 40, "d_kv": 8, "num_heads": 3, "num_layers": 2, "vocab_size": 12}
VIT = {**clip.SIZES, "hidden_size": 24, "intermediate_size": 40, "num_hidden_layers": 3, "num_attention_heads": 3,
       "image_size": 28, "patch_size": 14}  # fmt: skip
CAPTIONS = ["a duck is pulled", "", "duck breaks"]


def filled(net: Any, seed: int = 0) -> Any:
    """A network on the CPU with random weights of the size that its layers keep signals at."""
    random = torch.Generator().manual_seed(seed)
    net = net.to_empty(device="cpu")
    for name, weight in net.named_parameters():
        spread = 1 / math.sqrt(weight.shape[-1]) if weight.ndim > 1 else 0.3
        offset = 1.0 if weight.ndim == 1 and "norm" in name and "bias" not in name else 0.0
        weight.data = offset + spread * torch.randn(weight.shape, generator=random)
    net.tie_weights()
    return net.eval()


def tokenizer(folder: Path) -> None:
    """Write a tokenizer of nine words that ends a caption as T5's does."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors
    from transformers import PreTrainedTokenizerFast

    words = ["<pad>", "</s>", "<unk>", "a", "duck", "is", "pulled", "breaks", "holds"]
    made = Tokenizer(models.WordLevel({word: k for k, word in enumerate(words)}, unk_token="<unk>"))
    made.pre_tokenizer = pre_tokenizers.Whitespace()
    made.post_processor = processors.TemplateProcessing(single="$A </s>", special_tokens=[("</s>", 1)])
    PreTrainedTokenizerFast(
        tokenizer_object=made, pad_token="<pad>", eos_token="</s>", unk_token="<unk>"
    ).save_pretrained(folder)


@pytest.fixture(scope="module")
def umt5_net() -> Any:
    return filled(umt5.network(T5))


@pytest.fixture(scope="module")
def umt5_folder(umt5_net: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """transformers layout."""
    folder = tmp_path_factory.mktemp("umt5")
    umt5_net.save_pretrained(folder / "text_encoder")
    tokenizer(folder / "tokenizer")
    return folder


@pytest.fixture(scope="module")
def umt5_released(umt5_net: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("released")
    state = umt5_net.state_dict()
    torch.save({name: state[ours].clone() for name, ours in umt5.table(state).items()}, folder / umt5.FILE)
    tokenizer(folder / umt5.TOKENIZER)
    return folder


def rms(x: Tensor, weight: Tensor) -> Tensor:
    return x / (x.square().mean(-1, keepdim=True) + 1e-6).sqrt() * weight


def bucket(distance: int) -> int:
    """Number of a key's distance (Raffel et al. 2020): 16 a side, half of them exact, half logarithmic up to 128."""
    side, far = (16 if distance > 0 else 0), abs(distance)
    return side + (far if far < 8 else min(15, 8 + int(math.log(far / 8) / math.log(128 / 8) * 8)))


def naive_t5(w: dict[str, Tensor], ids: list[int]) -> Tensor:
    """The encoder of Wan2.1, written from its released weights: one caption, one head after the other."""
    x = w["token_embedding.weight"][ids]
    for k in range(T5["num_layers"]):
        b = {name.removeprefix(f"blocks.{k}."): value for name, value in w.items() if name.startswith(f"blocks.{k}.")}
        h = rms(x, b["norm1.weight"])
        q, key, v = (h @ b[f"attn.{part}.weight"].T for part in "qkv")
        table = b["pos_embedding.embedding.weight"]
        heads = []
        for head in range(T5["num_heads"]):
            cut = slice(head * T5["d_kv"], (head + 1) * T5["d_kv"])
            bias = torch.tensor([[float(table[bucket(j - i), head]) for j in range(len(ids))] for i in range(len(ids))])
            heads.append((q[:, cut] @ key[:, cut].T + bias).softmax(-1) @ v[:, cut])
        x = x + torch.cat(heads, -1) @ b["attn.o.weight"].T
        h = rms(x, b["norm2.weight"])
        gate = functional.gelu(h @ b["ffn.gate.0.weight"].T, approximate="tanh")
        x = x + (h @ b["ffn.fc1.weight"].T * gate) @ b["ffn.fc2.weight"].T
    return rms(x, w["norm.weight"])


def test_names_and_shapes_of_umt5_at_full_size_are_those_of_the_released_file() -> None:
    state = umt5.network(umt5.SIZES).state_dict()
    mine = {name: list(state[ours].shape) for name, ours in umt5.table(state).items()}
    assert mine == json.loads(T5_KEYS.read_text())
    assert len(mine) == 242


def test_umt5_computes_what_the_released_encoder_computes(umt5_net: Any, umt5_folder: Path) -> None:
    """Against a forward pass written from the released names; float32 sums of some 40 terms: 1e-5."""
    state = umt5_net.state_dict()
    w = {name: state[ours] for name, ours in umt5.table(state).items()}
    encoder = encoders.text(Encoders(text_path=str(umt5_folder)), T5["d_model"])
    long = "duck holds " * 40  # far enough for logarithmic distances
    ids = [[3, 4, 5, 6, 1], [1], [4, 7, 1], [4, 8] * 40 + [1]]
    for one, expected in zip(encoder.encode([*CAPTIONS, long]), ids, strict=True):
        assert one.shape == (len(expected), T5["d_model"])
        torch.testing.assert_close(one, naive_t5(w, expected), rtol=1e-5, atol=1e-5)


def test_both_layouts_of_umt5_embed_alike(
    umt5_folder: Path, umt5_released: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit for bit; the released file has no config, so the test tells the program its sizes."""
    monkeypatch.setattr(umt5, "SIZES", T5)
    first, second = (encoders.text(Encoders(text_path=str(folder)), T5["d_model"])
                     for folder in (umt5_folder, umt5_released))  # fmt: skip
    assert all(torch.equal(a, b) for a, b in zip(first.encode(CAPTIONS), second.encode(CAPTIONS), strict=True))
    assert first.identity == encoders.text_identity(Encoders(text_path=str(umt5_folder)), T5["d_model"])


def test_the_embedding_of_tokens_is_tied_and_not_zero(umt5_net: Any, umt5_folder: Path) -> None:
    """Some releases of transformers left it zero, so that every caption was the same (transformers#43880)."""
    net = encoders.text(Encoders(text_path=str(umt5_folder)), T5["d_model"]).network  # type: ignore[attr-defined]
    assert net.encoder.embed_tokens.weight is net.shared.weight
    assert torch.equal(net.shared.weight, umt5_net.shared.weight)
    dead = {name: value * 0 for name, value in umt5_net.state_dict().items()}
    with pytest.raises(ValueError, match="the embedding of tokens is zero"):
        umt5.fill(umt5.network(T5), dead, "file")


def test_an_embedding_is_padded_with_zeros_after_its_end(umt5_folder: Path) -> None:
    found = encoders.text(Encoders(text_path=str(umt5_folder)), T5["d_model"]).encode(CAPTIONS)
    padded = encoders.pad(found)
    assert padded.shape == (3, encoders.TOKENS, T5["d_model"])
    for row, one in zip(padded, found, strict=True):
        assert torch.equal(row[: len(one)], one)
        assert not row[len(one) :].any()
        assert one.any(dim=1).all()


def test_a_caption_beyond_512_tokens_is_cut(umt5_folder: Path) -> None:
    for cfg in (Encoders(text_path=str(umt5_folder)), Encoders(text="words")):
        (one,) = encoders.text(cfg, T5["d_model"]).encode(["duck " * 600])
        assert len(one) == encoders.TOKENS == 512


def test_captions_are_cleaned_as_the_base_s_were() -> None:
    assert umt5.clean("  a  duck &amp;amp;\n is\tpulled ") == "a duck & is pulled"


def test_missing_and_unfit_encoders_are_refused_by_name(umt5_folder: Path) -> None:
    with pytest.raises(ValueError, match=r"encoders.text_path= holds no UMT5: .* encoders.text=words needs no weights"):
        encoders.text(Encoders(), 4096)
    with pytest.raises(ValueError, match=r"has 24 channels, but model.text_dim=4096: set model.text_dim=24"):
        encoders.text(Encoders(text_path=str(umt5_folder)), 4096)
    with pytest.raises(
        ValueError, match=r"encoders.image_path= holds no CLIP: .* encoders.image=zeros needs none|weights"
    ):
        encoders.image(Encoders())


def test_words_are_vectors_of_one_length_that_keep_the_order() -> None:
    """Deviation 1 of a word and 0.3 of its place; equal words differ by their places only."""
    encoder = encoders.text(Encoders(text="words"), 64)
    first, second = encoder.encode(["A duck. A duck", "Duck, a duck a"])
    assert first.shape == (5, 64)
    assert encoder.identity == "words-64" == encoders.text_identity(Encoders(text="words"), 64)
    assert not torch.equal(first[0], first[2])
    assert float((first[0] - first[2]).norm()) < 2 * 0.3 * 8 + 1e-6  # both places have the norm 0.3 sqrt(64)
    torch.testing.assert_close(first.sum(dim=0), second.sum(dim=0))  # the same words and the same places
    assert float((first - second).abs().max()) > 1
    assert [len(one) for one in encoder.encode([""])] == [1]


def test_words_are_the_same_in_another_process() -> None:
    code = "from fracgen import encoders; from fracgen.config.model import Encoders\n"
    code += "print(encoders.text(Encoders(text='words'), 8).encode(['A star holds'])[0].tolist())"
    here = encoders.text(Encoders(text="words"), 8).encode(["A star holds"])[0].tolist()
    assert json.loads(python(code)) == here


@pytest.fixture(scope="module")
def vit() -> Any:
    net = filled(clip.network(VIT))
    net.embeddings.position_ids = torch.arange(5)[None]
    return net


def naive_vit(w: dict[str, Tensor], pixels: Tensor) -> Tensor:
    """All blocks but the last of the released vision transformer, written from its own weights; one picture."""
    dim, heads, patch = VIT["hidden_size"], VIT["num_attention_heads"], VIT["patch_size"]
    patches = pixels.unfold(1, patch, patch).unfold(2, patch, patch).permute(1, 2, 0, 3, 4).reshape(4, -1)
    x = patches @ w["patch_embedding.weight"].reshape(dim, -1).T
    x = torch.cat([w["cls_embedding"][0], x]) + w["pos_embedding"][0]
    x = functional.layer_norm(x, (dim,), w["pre_norm.weight"], w["pre_norm.bias"])
    for k in range(VIT["num_hidden_layers"] - 1):
        b = {n.removeprefix(f"transformer.{k}."): v for n, v in w.items() if n.startswith(f"transformer.{k}.")}
        h = functional.layer_norm(x, (dim,), b["norm1.weight"], b["norm1.bias"])
        q, key, v = (h @ b["attn.to_qkv.weight"].T + b["attn.to_qkv.bias"]).reshape(5, 3, heads, -1).permute(1, 2, 0, 3)
        mixed = (q @ key.mT / math.sqrt(dim / heads)).softmax(-1) @ v
        x = x + mixed.transpose(0, 1).reshape(5, dim) @ b["attn.proj.weight"].T + b["attn.proj.bias"]
        h = functional.layer_norm(x, (dim,), b["norm2.weight"], b["norm2.bias"])
        h = functional.gelu(h @ b["mlp.0.weight"].T + b["mlp.0.bias"])
        x = x + h @ b["mlp.2.weight"].T + b["mlp.2.bias"]
    return x


def test_clip_computes_what_the_released_encoder_computes(vit: Any) -> None:
    rgb = torch.randint(0, 256, (2, 40, 30, 3), dtype=torch.uint8, generator=torch.Generator().manual_seed(0))
    w = {n.removeprefix("visual."): v for n, v in clip.of_released(vit.state_dict()).items()}
    tokens = clip.ImageEncoder(vit, "").encode(rgb)
    assert tokens.shape == (2, 5, 24)
    for one, pixels in zip(tokens, clip.prepare(rgb, 28), strict=True):
        torch.testing.assert_close(one, naive_vit(w, pixels), rtol=1e-5, atol=1e-5)


def test_both_layouts_of_clip_encode_alike(vit: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bit for bit; the released file also holds a text encoder and a head, which are left out."""
    monkeypatch.setattr(clip, "SIZES", VIT)
    vit.save_pretrained(tmp_path / "image_encoder")
    extra = {"visual.head": torch.zeros(24, 8), "textual.head.0.weight": torch.zeros(3), "log_scale": torch.zeros(())}
    torch.save(clip.of_released(vit.state_dict()) | extra, tmp_path / "clip.pth")
    rgb = torch.randint(0, 256, (1, 30, 30, 3), dtype=torch.uint8)
    for path in (tmp_path, tmp_path / "image_encoder", tmp_path / "clip.pth"):
        encoder = encoders.image(Encoders(image_path=str(path)))
        assert encoder is not None
        assert encoder.identity == encoders.image_identity(Encoders(image_path=str(path)))
        assert torch.equal(encoder.encode(rgb), clip.ImageEncoder(vit, "").encode(rgb))


def test_clip_at_full_size_has_the_layers_of_the_released_file() -> None:
    """12 tensors a block there and 16 in transformers, since query, key and value are one; 257 tokens of 1280."""
    state = clip.network(clip.SIZES).state_dict()
    theirs = clip.of_released(state)
    assert (len(state), len(theirs)) == (7 + 32 * 16, 7 + 32 * 12)
    shapes = {name: tuple(theirs[f"visual.{name}"].shape) for name in (
        "cls_embedding", "pos_embedding", "patch_embedding.weight", "transformer.31.attn.to_qkv.weight",
        "transformer.0.mlp.0.weight")}  # fmt: skip
    assert list(shapes.values()) == [(1, 1, 1280), (1, 257, 1280), (1280, 3, 14, 14), (3840, 1280), (5120, 1280)]


def test_a_clip_with_a_wrong_tensor_is_refused_by_name(vit: Any) -> None:
    tensors = clip.of_released(vit.state_dict())
    tensors["visual.transformer.1.attn.to_qkv.bias"] = torch.zeros(3 * 8)
    del tensors["visual.post_norm.bias"]
    with pytest.raises(ValueError, match=r"lacks post_layernorm.bias; .*layers.1.self_attn.\w+.bias \[8\] instead"):
        clip.fill(clip.network(VIT), tensors, "file")


def test_pictures_are_squeezed_and_normalised() -> None:
    """A grey picture is the same whatever its size: (grey - mean) / std."""
    out = clip.prepare(torch.full((1, 50, 30, 3), 51, dtype=torch.uint8), 224)
    expected = (0.2 - torch.tensor(clip.MEAN)) / torch.tensor(clip.STD)
    assert out.shape == (1, 3, 224, 224)
    torch.testing.assert_close(out.amax(dim=(0, 2, 3)), expected)
    torch.testing.assert_close(out.amin(dim=(0, 2, 3)), expected)
    with pytest.raises(ValueError, match=r"rgb: torch.float32 \[1, 4, 4, 3\] must be uint8"):
        clip.ImageEncoder(None, "").encode(torch.zeros(1, 4, 4, 3))


def test_without_clip_there_is_no_picture_encoder() -> None:
    assert encoders.image(Encoders(image="zeros")) is None
    assert encoders.image_identity(Encoders(image="zeros")) == "zeros"
