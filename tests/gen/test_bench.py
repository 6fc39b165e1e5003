"""The measurements of the generator run at their smallest size and leave complete tables; no time is asserted."""

import csv

import pytest

from fracgen.bench import __main__ as command
from fracgen.bench import memory, record
from fracgen.bench.record import Row


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
