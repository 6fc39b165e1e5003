"""An evaluation goes on where it stopped, observes what has changed, and is the same in several processes."""

import gc
import weakref
from pathlib import Path

import pytest

from fracgen.config.evaluate import Scores
from fracgen.evaluation import code, job, load, observe, pairing
from fracgen.evaluation.clip import Pair
from fracgen.evaluation.journal import FILE
from tests.metrics.folders import config, film, grey, results


def test_clips_are_observed_once_and_again_after_a_change(films: Path, looked: Path) -> None:
    """Not for another name of the clips or other groups of results; but for other settings, rules and contents."""
    first = job.run(config(films))
    again = job.run(config(films, resamples=30, by=[]))
    assert looked.read_text().split() == ["a", "b", "c"]
    assert results(first) == results(again)
    job.run(config(films, metric={"brightness": {"gain": 2.0}}))
    assert len(looked.read_text().split()) == 6
    film(films / "pred" / "b.mkv", grey(130))
    job.run(config(films))
    assert looked.read_text().split()[6:] == ["b"]
    job.run(config(films, alignment="spread"))
    assert looked.read_text().split()[7:] == ["a", "b", "c"]
    job.run(config(films, output=Scores(folder=str(films / "out"), overwrite=True)))
    assert len(looked.read_text().split()) == 13


def test_an_evaluation_that_was_interrupted_goes_on(films: Path, looked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Killed while it writes the second line: half of it is on disk, and no result."""
    look, calls = observe.look, iter(range(9))

    def interrupted(*arguments: object) -> observe.Seen:
        if next(calls) == 1:
            raise KeyboardInterrupt
        return look(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(observe, "look", interrupted)
    with pytest.raises(KeyboardInterrupt):
        job.run(config(films))
    journal = films / "out" / FILE
    line = journal.read_text()
    assert line.count("\n") == 1
    journal.write_text(line + line[: len(line) // 2])
    assert not (films / "out" / "metrics.json").exists()
    done = job.run(config(films))
    assert looked.read_text().split() == ["a", "b", "c"]
    assert results(done) == pytest.approx({"difference": 70 / 3 / 255, "largest": 40 / 255})
    assert job.run(config(films)).document["metrics"]["brightness"]["n"] == 3
    assert looked.read_text().split() == ["a", "b", "c"]


def test_two_processes_find_what_one_finds(films: Path) -> None:
    alone = job.run(config(films, output=Scores(folder=str(films / "alone"))))
    together = job.run(config(films, workers=2))
    assert results(alone) == results(together)
    assert (films / "alone/per_clip.csv").read_text() == (films / "out/per_clip.csv").read_text()


def test_states_that_are_merged_give_what_one_state_gives(films: Path) -> None:
    """As torchmetrics merges processes: rows are concatenated."""
    cfg = config(films)
    choice = job.choose.choices({}, cfg.outside)[0]
    whole, first, second = (choice.build() for _ in range(3))
    pairs: list[Pair] = [load.pair(couple, cfg) for couple in pairing.pairs(cfg).couples]
    for k, pair in enumerate(pairs):
        whole.update(pair)
        (first, second)[k % 2].update(pair)
    first.merge_state(second)
    assert first.compute() == pytest.approx(whole.compute())
    whole.reset()
    assert whole.compute() == {}


def test_what_an_observation_rests_on_are_all_files_that_are_imported(tmp_path: Path) -> None:
    """The base of metrics, and what that imports; a changed line is another hash."""
    mine = tmp_path / "mine.py"
    mine.write_text("from fracgen.evaluation.metric import Metric\n")
    before = code.digest(mine)
    assert {path.name for path in code._imported(mine.read_bytes())} == {"metric.py"}
    assert code.digest(mine) == before
    mine.write_text(mine.read_text() + "# changed\n")
    assert code.digest(mine) != before


def test_one_pair_is_in_memory_at_a_time(films: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pair, alive = load.pair, []

    def counted(*arguments: object) -> Pair:
        gc.collect()
        assert [there for one in alive if (there := one()) is not None] == []
        made = pair(*arguments)  # type: ignore[arg-type]
        alive.extend([weakref.ref(made), weakref.ref(made.pred)])
        return made

    monkeypatch.setattr(load, "pair", counted)
    assert job.run(config(films)).document["metrics"]["brightness"]["n"] == 3
    assert len(alive) == 6
