"""What a training leaves behind: written at once, read with care, put only where it belongs."""

from dataclasses import asdict

import pytest
import torch
from safetensors.torch import save_file

from fracgen.model import adapter, trained
from tests.gen.small import config, forward, plain, train


def prepared(**changes):
    cfg = config(**changes)
    transformer = plain(cfg)
    adapter.prepare(transformer, cfg)
    return transformer


def about(**changes):
    out = {"stage": 2, "streams": ["rgb", "damage"], "model": asdict(config()), "base": "0123456789ab",
           "scalars": ["E"], "conditioning": {"height": "tile"}, "config": {"seed": 0}}  # fmt: skip
    return {**out, **changes}


def written(folder, tensors=None, **changes):
    path = folder / trained.FILE
    trained.save(path, tensors or {"transformer.x": torch.arange(3.0)}, about(**changes))
    return path


@pytest.mark.parametrize("changes", [{}, {"train_patch_embed": "full"}, {"train_patch_embed": "new_channels"},
                                     {"train": "full"}])  # fmt: skip
def test_a_trained_model_comes_back_bit_for_bit(tmp_path, changes):
    first = prepared(**changes)
    train(first, steps=2)
    path = written(tmp_path, {f"transformer.{n}": t for n, t in trained.state(first).items()})
    second = prepared(**changes)
    trained.apply(second, trained.part(trained.read(path)[0], "transformer"))
    assert torch.equal(forward(first), forward(second))


def test_only_what_was_trained_is_stored():
    transformer = prepared()
    assert trained.state(transformer).keys() == {n for n, p in transformer.named_parameters() if p.requires_grad}


def test_the_folder_of_a_run_stands_for_its_file(tmp_path):
    path = written(tmp_path)
    for given in (tmp_path, str(tmp_path), path):
        tensors, told = trained.read(given)
        assert torch.equal(tensors["transformer.x"], torch.arange(3.0))
        assert told == about(version=1)


def test_tensors_of_the_transformer_and_of_the_constitutive_maps_are_told_apart():
    tensors = {"transformer.a": torch.zeros(1), "constitutive.f.weight": torch.ones(2)}
    assert list(trained.part(tensors, trained.CONSTITUTIVE)) == ["f.weight"]
    assert list(trained.part(tensors, trained.TRANSFORMER)) == ["a"]


def test_a_file_is_complete_or_not_there(tmp_path, monkeypatch):
    path = written(tmp_path)
    before = path.read_bytes()

    def interrupted(content, file, metadata):
        file.write_bytes(b"half")
        raise OSError("no space left")

    monkeypatch.setattr(trained, "save_file", interrupted)
    with pytest.raises(OSError, match="no space"):
        trained.save(path, {"transformer.x": torch.zeros(3)}, about())
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [trained.FILE]


def test_a_file_has_the_rights_of_any_new_file(tmp_path):
    (tmp_path / "other").touch()
    assert written(tmp_path).stat().st_mode == (tmp_path / "other").stat().st_mode


def test_missing_extra_and_misshapen_tensors_are_named_and_nothing_changes():
    transformer = prepared()
    tensors = dict(trained.state(transformer))
    names = sorted(tensors)
    before = {n: t.clone() for n, t in tensors.items()}
    tensors = {n: t + 1 for n, t in tensors.items()}
    del tensors[names[0]]
    tensors[names[1]] = torch.zeros(7, 7)
    tensors["surplus"] = torch.zeros(1)
    with pytest.raises(ValueError, match="trained weights do not fit") as error:
        trained.apply(transformer, tensors)
    told = str(error.value)
    assert f"1 missing: {names[0]}" in told
    assert "1 too many: surplus" in told
    assert f"1 of another shape: {names[1]} [7, 7] instead of" in told
    assert all(torch.equal(t, before[n]) for n, t in trained.state(transformer).items())


def test_another_base_and_another_stage_are_refused():
    with pytest.raises(ValueError, match="run=r belongs to base weights 0123456789ab, but the model has ffffffffffff"):
        trained.check_base(about(), "ffffffffffff", "r")
    with pytest.raises(ValueError, match="init_from=r is a run of stage 2, but stage 1 is wanted"):
        trained.check_stage(about(), 1, "r")
    trained.check_base(about(), "0123456789ab", "r")
    trained.check_stage(about(), 2, "r")


def test_an_unknown_version_is_refused(tmp_path):
    path = tmp_path / trained.FILE
    save_file({"x": torch.zeros(1)}, path, {"about": '{"version": 99}'})
    with pytest.raises(ValueError, match="format version 99, but this program reads version 1"):
        trained.read(path)


def test_missing_damaged_foreign_and_incomplete_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"has no trained\.safetensors: give the folder"):
        trained.read(tmp_path)
    path = written(tmp_path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(ValueError, match=r"cannot be read .* damaged"):
        trained.read(path)
    save_file({"x": torch.zeros(1)}, path)
    with pytest.raises(ValueError, match=r"was not written by fracgen\.train"):
        trained.read(path)
    save_file({"x": torch.zeros(1)}, path, {"about": '{"version": 1, "stage": 1}'})
    with pytest.raises(ValueError, match="does not say its streams, model, base"):
        trained.read(path)


def test_the_model_of_a_run_is_known_from_its_file(tmp_path):
    _, told = trained.read(written(tmp_path))
    assert trained.model_of(told) == config()
    with pytest.raises(ValueError, match=r"unknown fields of the model .colour"):
        trained.model_of({"model": {**asdict(config()), "colour": 1}})
