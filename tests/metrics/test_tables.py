"""`python -m fracgen.tables`: the paper's figures beside ours, and a reason in each empty cell."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from fracgen import tables
from fracgen.evaluation import paper

TEX = {
    "Table 1": ("ForcePrompting-FT", 933.21, 0.29, 15.93, 0.092),
    "Ablation": ("Stage 3", 266.17, 0.1502, 21.19, 0.9462, 0.536, 0.01147, 0.00429, 0.02681, 0.02740, 0.01749, 0.902),
    "Baselines": ("CogVideoX-5B-I2V", 1844.92, 0.34, 13.78, 0.470),
}
"""A row of each table, copied from the paper's source a second time."""


def results(folder: Path, stage: int | None = None, missing: dict[str, str] | None = None, **values: float) -> Path:
    """Results of an evaluation, as metric__result=value."""
    metrics: dict[str, Any] = {}
    for name, value in values.items():
        metric, _, result = name.partition("__")
        entry = metrics.setdefault(metric, {"n": 24, "results": {}, "by": {}, "undefined": {}, "higher": {}})
        entry["results"][result or metric] = {"value": value, "low": None, "high": None}
    folder.mkdir(parents=True)
    run = {} if stage is None else {"stage": stage, "producer": "fracgen 1.0"}
    document = {"run": run, "metrics": metrics, "missing": missing or {}, "command": f"score {folder.name}"}
    (folder / "metrics.json").write_text(json.dumps(document))
    return folder


def cells(text: str, title: str, row: str) -> dict[str, list[str]]:
    """The cells of a row by metric: paper, ours, n, command."""
    part = next(part for part in text.split("## ") if part.startswith(title))
    found, inside = {}, False
    for line in part.splitlines():
        if not line.startswith("|"):
            continue
        name, metric, *rest = (cell.strip() for cell in line.strip("|").split("|"))
        inside = name == row if name else inside
        if inside:
            found[re.sub(r" [↑↓]", "", metric)] = rest
    return found


@pytest.mark.parametrize("title", TEX)
def test_the_figures_are_those_of_the_paper(title: str, tmp_path: Path) -> None:
    text = tables.tables(tables.evaluations([str(results(tmp_path / "a", psnr=1.0))]))
    row, *figures = TEX[title]
    assert [float(line[0]) for line in cells(text, title, str(row)).values()] == figures


def test_the_overall_error_of_the_paper_is_the_mean_of_its_maps() -> None:
    """To half of the last digit printed."""
    for figures in (paper.STAGES["Stage 2"], paper.STAGES["Stage 3"]):
        *maps, overall = [value for value in figures[5:10] if value is not None]
        assert sum(maps) / 4 == pytest.approx(overall, abs=5e-6)


def test_stages_are_found_by_what_the_results_say(tmp_path: Path) -> None:
    for stage in (1, 3):
        results(tmp_path / f"s{stage}" / "evaluation", stage, psnr=20.0 + stage, map_mse__mse=0.1)
    text = tables.tables(tables.evaluations([str(tmp_path)]))
    assert cells(text, "Ablation", "Stage 1")["PSNR"] == ["20.73", "21", "24", "A"]
    assert cells(text, "Ablation", "Stage 3")["MSE overall"] == ["0.01749", "0.1", "24", "B"]
    assert cells(text, "Ablation", "Stage 2")["PSNR"] == ["20.82", "– (no results given)", "", ""]
    assert cells(text, "Table 1", "FracGen")["PSNR"] == ["21.19", "23", "24", "B"]
    assert "- B: `score evaluation`" in text
    assert "producer fracgen 1.0, stage 3" in text


def test_a_name_chooses_the_row(tmp_path: Path) -> None:
    folder = results(tmp_path / "x", psnr=14.0, sac=0.4)
    text = tables.tables(tables.evaluations([f"phyco ft={folder}"]))
    assert cells(text, "Table 1", "PhyCo-FT")["PSNR"][:2] == ["14.18", "14"]
    assert cells(text, "Baselines", "PhyCo-FT")["SAC"][:2] == ["0.434", "0.4"]


def test_another_name_gets_a_row_of_its_own(tmp_path: Path) -> None:
    """In the ablation if it has a stage."""
    plain, staged = results(tmp_path / "x", psnr=14.0), results(tmp_path / "y", 3, psnr=15.0, ssim=0.5)
    text = tables.tables(tables.evaluations([f"simulator={plain}", f"no loss={staged}"]))
    assert cells(text, "Table 1", "simulator")["PSNR"] == ["–", "14", "24", "A"]
    assert cells(text, "Ablation", "no loss")["PSNR"] == ["–", "15", "24", "B"]
    assert cells(text, "Ablation", "no loss")["SSIM"][1] == "0.5"
    assert cells(text, "Ablation", "Stage 3")["PSNR"][1] == "– (no results given)"


def test_an_empty_cell_says_why(tmp_path: Path) -> None:
    folder = results(tmp_path / "x", 2, missing={"lpips": "AlexNet was not found"}, sac=float("nan"), psnr=1.0)
    document = json.loads((folder / "metrics.json").read_text())
    document["metrics"]["sac"]["results"]["sac"]["value"] = None
    (folder / "metrics.json").write_text(json.dumps(document))
    row = cells(tables.tables(tables.evaluations([str(folder)])), "Ablation", "Stage 2")
    assert row["LPIPS"][1] == "– (AlexNet was not found)"
    assert row["FVD"][1] == "– (fvd was not asked for: metric=[...,fvd])"
    assert row["SAC"][1] == "– (undefined for every clip)"


def test_a_folder_without_results_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "metrics.json").write_text("[1, 2]")
    with pytest.raises(SystemExit, match="2"):
        tables.main([str(tmp_path)])
    assert "holds no results (metrics.json)" in capsys.readouterr().err
