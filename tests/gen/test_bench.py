"""The measurements of the generator run at their smallest size and leave complete tables; no time is asserted."""

import csv

import pytest
import torch

from fracgen import layout
from fracgen.bench import __main__ as command
from fracgen.bench import cases, control, memory, overfit, pareto, record
from fracgen.bench.field import Source, load
from fracgen.bench.pareto import Point, Setting
from fracgen.bench.record import Row
from fracgen.layout import STREAMS


def _table(folder):
    (path,) = folder.glob("*.csv")
    with path.open(newline="", encoding="utf-8") as file:
        return path.name, list(csv.DictReader(file))


@pytest.mark.parametrize(("name", "benchmarks"), [
    ("step", {"largest speed of a matrix product", "a clip, forward and backward", "tokens",
              "share of the machine's peak", "attention back-end"}),
    ("loader", {"a clip from the cache", "a clip encoded live", "tokens by the trainer", "tokens by a plain loop",
                "time that the trainer adds", "waiting for data, share of a step"}),
    ("memory", {"peak memory, measured", "peak memory, planned", "difference"}),
    ("overfit", {"first loss", "last loss", "last over first loss", "error of sampled latents",
                 "PSNR of the sampled clips", "force, material, caption swapped", "force and material swapped"}),
    ("control", {"dpa of samples", *(f"loss with {name} of another clip over that with its own"
                                     for name in control.CONDITIONS)}),
    ("pareto", {"processor time", "of it decoding", "wall time", "error of latents", "on the front",
                *(f"error of {name}, decoded" for name in STREAMS)}),
    ("skips", {"no map decoded that is not asked for, measured", "no map encoded that is not asked for, measured",
               "no map predicted in stage 1, measured", "no second pass at guidance 1, measured",
               "keys of the caption kept over the steps, measured", "no map predicted in stage 1, counted",
               "keys of caption and picture kept over the steps, counted",
               "no pass of the encoder of the caption (UMT5-xxl) when cached, counted",
               "no pass of the encoder of the picture (CLIP ViT-H/14) when cached, counted"}),
])  # fmt: skip
def test_a_part_measures_all_its_figures_and_stores_them(tmp_path, capsys, name, benchmarks):
    assert command.main(["--quick", name, "--out", str(tmp_path)]) == 0
    file, rows = _table(tmp_path)
    assert file.endswith(f"_gen_{name}_quick.csv")
    assert {row["benchmark"] for row in rows} == benchmarks
    assert all(float(row["value"]) == float(row["value"]) for row in rows), "no value is missing or nan"
    assert all(row[column] for row in rows for column in ("variant", "unit", "device", "torch", "commit", "date"))
    assert "stored in" in capsys.readouterr().out


def test_a_target_is_met_or_missed_by_the_value():
    assert Row("a", "b", 3.0, "%", most=3.0).met == "yes"
    assert Row("a", "b", 3.1, "%", most=3.0).met == "no"
    assert Row("a", "b", 3.0, "%", least=4.0).met == "no"
    assert Row("a", "b", 3.0, "%").met == ""


def test_repeats_give_their_median_and_the_smallest():
    row = record.median("a", "b", [5.0, 1.0, 2.0], "ms")
    assert (row.value, row.best) == (2.0, 1.0)


def test_ctrl_c_stores_nothing_half_done(tmp_path, monkeypatch, capsys):
    def broken(quick):
        yield Row("peak memory", "first", 1.0, "MB")
        raise KeyboardInterrupt

    monkeypatch.setattr(memory, "rows", broken)
    assert command.main(["memory", "--out", str(tmp_path)]) == 130
    assert not list(tmp_path.iterdir())
    assert "first" in capsys.readouterr().out


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit):
        command.main(["speed"])
    assert "NAME=speed is not known: choose from step, loader, memory" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["pareto", "overfit", "control"])
def test_a_part_that_needs_a_trained_network_says_so(capsys, name):
    with pytest.raises(SystemExit):
        command.main([name])
    assert f"NAME={name} needs a trained network: give --run FOLDER and --vae FOLDER" in capsys.readouterr().err


def _point(seconds, error):
    return Point(Setting("euler", 1), seconds, 0.0, seconds, torch.zeros(1), {}, error)


def test_the_front_has_what_nothing_beats_in_both_time_and_error():
    fast, good, poor, slow = (_point(*p) for p in ((1, 0.5), (2, 0.1), (3, 0.2), (4, 0.1)))
    assert pareto.front([slow, poor, good, fast]) == [fast, good]


def test_the_presets_of_the_sampler_get_slower():
    named = pareto.presets()
    assert list(named) == ["preview", "default", "reference"]
    steps = [setting.steps for setting in named.values()]
    assert steps == sorted(set(steps))


def test_psnr_is_that_of_a_known_difference():
    """10 log10(1 / 0.1^2) = 20 dB."""
    x = torch.zeros(3, 2, 4, 4)
    assert overfit.psnr(x, x + 0.1) == pytest.approx(20, abs=1e-5)
    assert overfit.psnr(x, x) == pytest.approx(100)


def test_the_loss_of_a_network_that_knows_the_answer_is_zero_and_of_one_that_says_nothing_that_of_the_target():
    """With a velocity of 0 the loss of a stream is the mean of |noise - x0|^2 over it, whatever the noise level."""
    field = load(Source("", "", 1))
    x0, noise = field.truth, field.x
    assert overfit.losses(field, lambda *_, **__: (noise - x0,)).max() < 1e-10
    silent = overfit.losses(field, lambda *_, **__: (torch.zeros_like(x0),))
    assert silent.shape == (5, 5)
    target = layout.split(noise - x0, STREAMS)
    expected = torch.stack([target[name].square().mean() for name in STREAMS])
    assert torch.allclose(silent, expected.expand(5, 5), rtol=1e-5)


def _clips(n):
    return cases.batch(cases.MODELS["tiny"], cases.Size(32, 32, 5, 5, n))


def test_a_condition_comes_from_the_next_clip_where_it_differs():
    batch = _clips(4)
    batch.scalars[:, 4] = torch.tensor([0.1, 0.1, 0.5, 0.1])
    batch.scalars[:, 5] = 0.7
    assert control.donors(batch, "thresholds") == [2, 2, 3, 2]
    batch.scalars[:, 1] = 0.3
    assert control.donors(batch, "nu") == [None] * 4


@pytest.mark.parametrize("name", control.CONDITIONS)
def test_one_condition_is_exchanged_and_all_others_stay(name):
    batch = _clips(3)
    changed = control.exchanged(batch, name, [2, None, 1])
    assert torch.equal(control.held(changed, name), control.held(batch, name)[[2, 1, 1]])
    for other in set(control.CONDITIONS) - {name}:
        assert torch.equal(control.held(changed, other), control.held(batch, other))
    assert all(torch.equal(changed.latents[stream], batch.latents[stream]) for stream in STREAMS)


def test_what_a_network_does_not_read_costs_it_nothing():
    """With weights of 0 for the two channels of the thresholds: 16 of noise and 20 of other conditions come before."""
    field = load(Source("", "", 3))
    network = field.build(torch.float32)
    network.patch_embedding.weight.data[:, 16 + 20 : 16 + 22] = 0
    own = control.losses(field, network, field.batch)
    given = control.donors(field.batch, "thresholds")
    (row, *_) = control.compared(field, network, "thresholds", given, own)
    assert row.value == 1
    (row, *_) = control.compared(field, network, "force", given, own)
    assert row.value != 1


def test_one_clip_has_no_other_to_take_a_condition_from(capsys, tmp_path):
    assert command.main(["--quick", "control", "--clips", "1", "--out", str(tmp_path)]) == 2
    assert "error: --clips 1" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
