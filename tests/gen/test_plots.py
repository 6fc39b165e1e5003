"""losses.png: which columns of metrics.csv it shows, and that a run without losses has none."""

from pathlib import Path

from PIL import Image

from fracgen.training import plots


def test_the_losses_of_a_run_are_drawn_against_the_step(tmp_path: Path) -> None:
    (tmp_path / "metrics.csv").write_text(
        "step,loss/total,loss/rgb,grad_norm,val/loss/flow,loss/sigma_0.1\n"
        "10,2.0,1.5,1,,9\n"
        "20,1.0,nan,1,0.5,9\n"
    )  # fmt: skip
    path = plots.losses(tmp_path)
    assert path == tmp_path / "losses.png"
    with Image.open(path) as picture:
        assert picture.size == (1100, 440)
    assert [file.name for file in tmp_path.iterdir() if "png" in file.name] == ["losses.png"]


def test_losses_are_shown_where_they_are_finite_and_those_at_single_noise_levels_not_at_all() -> None:
    rows = {10: {"step": "10", "loss/total": "2", "loss/rgb": "1.5", "grad_norm": "1", "loss/sigma_0.1": "9"},
            20: {"loss/total": "1", "loss/rgb": "nan", "val/loss/flow": "0.5", "loss/const_weight": "1"}}  # fmt: skip
    assert plots.curves(rows) == {"loss/total": ([10, 20], [2, 1]), "loss/rgb": ([10], [1.5]),
                                  "val/loss/flow": ([20], [0.5])}  # fmt: skip


def test_a_run_without_metrics_has_no_picture(tmp_path: Path) -> None:
    assert plots.losses(tmp_path) is None
    (tmp_path / "metrics.csv").write_text("step,grad_norm\n1,2\n")
    assert plots.losses(tmp_path) is None
    assert not list(tmp_path.glob("*.png"))
