"""What a training has made, for other programs: the names they know, and nothing lost on the way there and back."""

import json
from dataclasses import asdict

import pytest
import torch
from diffusers.loaders.lora_conversion_utils import _convert_non_diffusers_wan_lora_to_diffusers
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from fracgen.config.export import COMFYUI, DIFFUSERS, MERGED, ExportConfig
from fracgen.config.model import Lora
from fracgen.export import EXPORT
from fracgen.model import adapter, base_identity, build, trained
from fracgen.model.export import export
from fracgen.model.lora_file import load_lora, read
from tests.gen.small import STREAMS, config, forward, plain, train


def run(folder, **changes):
    """A finished run of a tiny model, and its output."""
    cfg = config(**changes)
    transformer = plain(cfg)
    adapter.prepare(transformer, cfg)
    train(transformer, steps=2)
    about = {"stage": 3, "streams": STREAMS, "model": asdict(cfg), "base": base_identity(cfg), "scalars": [],
             "conditioning": {}, "config": {}}  # fmt: skip
    folder.mkdir(exist_ok=True)
    tensors = {f"transformer.{name}": tensor for name, tensor in trained.state(transformer).items()}
    trained.save(folder / trained.FILE, tensors, about)
    with torch.no_grad():
        return folder, cfg, forward(transformer)


def exported(folder, naming, **changes):
    return export(ExportConfig(run=str(folder), naming=naming, **changes))


@pytest.mark.parametrize("changes", [{}, {"train": "full"}, {"train_patch_embed": "new_channels"}, {"rope": "shared"},
                                     {"lora": Lora(rank=4, alpha=3.0)}])  # fmt: skip
def test_the_transformer_of_a_run_is_assembled_bit_for_bit(tmp_path, changes):
    folder, _, expected = run(tmp_path, **changes)
    transformer = trained.assemble(folder)
    assert not transformer.training
    with torch.no_grad():
        assert torch.equal(forward(transformer), expected)


@pytest.mark.parametrize("changes", [{}, {"train": "full"}, {"train_patch_embed": "full"}])
def test_a_run_is_assembled_in_the_type_that_is_asked_for(tmp_path, changes):
    """bfloat16 has 8 bits: 1 / 256 for each of some tens of roundings on the way."""
    folder, _, expected = run(tmp_path, **changes)
    transformer = trained.assemble(folder, dtype=torch.bfloat16)
    kinds = {n: p.dtype for n, p in transformer.named_parameters()}
    assert {kinds[n] for n in kinds if "attn1.to_q" in n or "patch_embedding" in n} == {torch.bfloat16}
    assert kinds["scale_shift_table"] == torch.float32
    with torch.no_grad():
        assert (forward(transformer) - expected).norm() < 0.05 * expected.norm()


def test_a_run_of_another_base_is_refused(tmp_path):
    folder, _, _ = run(tmp_path)
    with pytest.raises(ValueError, match=r"belongs to base weights random-0-.*, but the model has random-1-"):
        trained.assemble(folder, model=config(seed=1))


@pytest.mark.parametrize("naming", [DIFFUSERS, COMFYUI])
@pytest.mark.parametrize("alpha", [4.0, 3.0])
def test_a_lora_comes_back_bit_for_bit_in_both_namings(tmp_path, naming, alpha):
    folder, cfg, expected = run(tmp_path, lora=Lora(rank=4, alpha=alpha))
    transformer = build(cfg, STREAMS)
    with torch.no_grad():
        before = forward(transformer)
        load_lora(transformer, exported(folder, naming))
        assert torch.equal(forward(transformer), expected)
    assert not torch.equal(before, expected)


def test_names_are_those_of_diffusers_and_of_comfyui(tmp_path):
    folder, _, _ = run(tmp_path)
    diffusers, comfyui = (load_file(exported(folder, naming)) for naming in (DIFFUSERS, COMFYUI))
    assert len(diffusers) == len(comfyui) == 2 * 20
    assert "transformer.blocks.0.attn1.to_q.lora_A.weight" in diffusers
    assert "transformer.blocks.1.ffn.net.0.proj.lora_B.weight" in diffusers
    assert "diffusion_model.blocks.0.self_attn.q.lora_A.weight" in comfyui
    assert "diffusion_model.blocks.0.cross_attn.o.lora_A.weight" in comfyui
    assert "diffusion_model.blocks.1.ffn.0.lora_B.weight" in comfyui


def test_diffusers_itself_reads_the_file_with_its_alpha(tmp_path):
    """As its pipelines do, which look into the metadata; load_lora_adapter alone does so for use_safetensors=True."""
    folder, cfg, expected = run(tmp_path, lora=Lora(rank=4, alpha=3.0))
    transformer = build(cfg, STREAMS)
    transformer.load_lora_adapter(exported(folder, DIFFUSERS), prefix="transformer", use_safetensors=True)
    with torch.no_grad():
        assert torch.equal(forward(transformer), expected)


def test_diffusers_turns_the_names_of_comfyui_into_its_own(tmp_path):
    """An oracle for the names that is not ours."""
    folder, _, _ = run(tmp_path)
    theirs = _convert_non_diffusers_wan_lora_to_diffusers(load_file(exported(folder, COMFYUI)))
    ours = load_file(exported(folder, DIFFUSERS))
    assert theirs.keys() == ours.keys()
    assert all(torch.equal(theirs[name], ours[name]) for name in ours)


def test_alpha_is_written_only_where_it_is_not_the_rank(tmp_path):
    folder, _, _ = run(tmp_path / "a", lora=Lora(rank=4, alpha=3.0))
    alphas = {n: t.item() for n, t in load_file(exported(folder, COMFYUI)).items() if n.endswith(".alpha")}
    assert set(alphas.values()) == {3.0}
    assert len(alphas) == 20
    folder, _, _ = run(tmp_path / "b")
    assert not any(n.endswith(".alpha") for n in load_file(exported(folder, COMFYUI)))


def test_the_file_says_what_it_comes_from(tmp_path):
    folder, cfg, _ = run(tmp_path)
    with safe_open(exported(folder, COMFYUI), framework="pt") as content:
        about = json.loads(content.metadata()["fracgen"])
    assert (about["stage"], about["base"]) == (3, base_identity(cfg))


@pytest.mark.parametrize(("changes", "named"), [({"train": "full"}, "blocks.0|scale_shift_table|patch_embedding"),
                                                ({"train_patch_embed": "full"}, "patch_embedding.weight"),
                                                ({"rope": "shared"}, "map_embed")])  # fmt: skip
def test_a_run_that_trained_more_than_a_lora_has_none(tmp_path, changes, named):
    folder, _, _ = run(tmp_path, **changes)
    with pytest.raises(ValueError, match=rf"run=.* trained .*({named}).* which a LoRA has no place for.*naming=merged"):
        exported(folder, DIFFUSERS)
    assert [p.name for p in folder.iterdir()] == [trained.FILE]


@pytest.mark.parametrize("changes", [{}, {"train": "full"}, {"train_patch_embed": "new_channels"}, {"rope": "shared"}])
def test_the_merged_model_is_a_base_that_predicts_what_the_run_did(tmp_path, changes):
    """W x + B A x against (W + B A) x: rounding of float32 on sums of 48 terms, through two blocks."""
    folder, _, expected = run(tmp_path, **changes)
    place = exported(folder, MERGED)
    merged = build(config(path=str(place), **changes), STREAMS)
    with torch.no_grad():
        torch.testing.assert_close(forward(merged), expected, rtol=1e-4, atol=1e-5)


def test_the_base_of_a_merged_model_may_have_moved(tmp_path):
    """A merged model is the base of a second run; that run is merged from a copy of this base."""
    folder, _, _ = run(tmp_path / "first")
    base = exported(folder, MERGED)
    folder, _, expected = run(tmp_path / "second", path=str(base))
    moved = base.rename(tmp_path / "elsewhere")
    place = exported(folder, MERGED, base=str(moved), output=str(tmp_path / "out"))
    with torch.no_grad():
        got = forward(build(config(path=str(place)), STREAMS))
    torch.testing.assert_close(got, expected, rtol=1e-4, atol=1e-5)


def test_a_loaded_lora_acts_beside_the_trained_one_which_stays_trained(tmp_path):
    """By adapter name: peft would train both, or the loaded one alone."""
    folder, cfg, _ = run(tmp_path)
    transformer = plain(cfg)
    adapter.prepare(transformer, cfg)
    load_lora(transformer, exported(folder, DIFFUSERS))
    assert transformer.active_adapters() == ["default", "loaded"]
    assert all(".default." in name for name, _ in adapter.trained(transformer))
    before = adapter.norms(transformer, "loaded")
    train(transformer, steps=2)
    assert adapter.norms(transformer, "loaded") == before
    assert not adapter.is_zero(transformer)
    with pytest.raises(ValueError, match="the transformer has an adapter loaded already"):
        load_lora(transformer, exported(folder, DIFFUSERS))


def test_a_lora_that_changes_nothing_is_reported(tmp_path):
    folder, cfg, _ = run(tmp_path)
    file = exported(folder, DIFFUSERS)
    save_file({n: t * ("lora_A" in n) for n, t in load_file(file).items()}, file)
    with pytest.warns(UserWarning, match="changes nothing: all its lora_B are 0"):
        load_lora(build(cfg, STREAMS), file)


def test_names_with_down_and_up_and_ranks_that_differ_are_read(tmp_path):
    names = {"lora_A": "lora_down", "lora_B": "lora_up"}
    A, B = torch.randn(3, 32), torch.randn(32, 3)
    other = {"diffusion_model.blocks.0.self_attn.k.lora_A.weight": torch.randn(2, 32),
             "diffusion_model.blocks.0.self_attn.k.lora_B.weight": torch.randn(32, 2)}  # fmt: skip
    content = {f"diffusion_model.blocks.0.self_attn.q.{names[n]}.weight": t for n, t in (("lora_A", A), ("lora_B", B))}
    save_file({**content, **other, "diffusion_model.blocks.0.self_attn.q.alpha": torch.tensor(1.5)}, tmp_path / "x")
    transformer = plain(config())
    load_lora(transformer, tmp_path / "x")
    query, key = transformer.blocks[0].attn1.to_q, transformer.blocks[0].attn1.to_k
    torch.testing.assert_close(query.get_delta_weight("loaded"), 1.5 / 3 * B @ A)
    assert key.scaling["loaded"] == 1.0


def test_files_that_are_no_lora_of_this_model_are_refused(tmp_path):
    file = tmp_path / "x.safetensors"
    with pytest.raises(ValueError, match=r"lora=.* cannot be read"):
        read(file)
    save_file({"blocks.0.norm.diff": torch.zeros(1)}, file)
    with pytest.raises(ValueError, match=r"holds blocks.0.norm.diff, which is no part of a LoRA"):
        read(file)
    save_file({"transformer.blocks.0.attn1.to_q.lora_A.weight": torch.zeros(4, 32)}, file)
    with pytest.raises(ValueError, match=r"holds lora_A of blocks.0.attn1.to_q only: it needs lora_A and lora_B"):
        read(file)
    pair = {"lora_A.weight": torch.zeros(4, 32), "lora_B.weight": torch.zeros(32, 4)}
    save_file({f"transformer.blocks.9.attn1.to_q.{n}": t for n, t in pair.items()}, file)
    with pytest.raises(ValueError, match=r"does not fit the transformer: blocks.9.attn1.to_q is no linear layer"):
        load_lora(plain(config()), file)
    save_file({f"transformer.blocks.0.ffn.net.2.{n}": t for n, t in pair.items()}, file)
    with pytest.raises(ValueError, match=r"blocks.0.ffn.net.2 has 48 inputs and 32 outputs, the file \[4, 32\]"):
        load_lora(plain(config()), file)


def test_the_command_line_composes_and_lists_its_fields():
    cfg = EXPORT.compose("run=runs/stage3-0", "naming=comfyui")
    assert (cfg.run, cfg.naming, cfg.dtype) == ("runs/stage3-0", COMFYUI, "float32")
    assert "naming" in EXPORT.manual()
    with pytest.raises(ValueError, match=r"naming=kohya is not allowed.*diffusers, comfyui, merged"):
        EXPORT.compose("naming=kohya")
