"""Metrics of pixels are found by name, and their files say what their settings are by default."""

from dataclasses import asdict
from typing import Any

import pytest
from omegaconf import OmegaConf

from fracsim import registry
from fracsim.scene.program import SIMULATE

NAMES = ("psnr", "ssim", "lpips", "stlpips", "map_mse", "iou", "vmaf")


@pytest.mark.parametrize("name", NAMES)
def test_the_file_of_a_metric_holds_its_defaults(name: str) -> None:
    file = SIMULATE.folder / "metric" / f"{name}.yaml"
    content: Any = OmegaConf.to_container(OmegaConf.load(file))
    assert content == asdict(registry.load("fracgen.metrics", name, "metric").Settings())
    first, second, *_ = file.read_text().splitlines()
    assert first == f"# @package metric.{name}"
    assert second.startswith("# ")


@pytest.mark.parametrize("name", ["psnr", "ssim", "map_mse", "iou"])
def test_results_are_named_and_have_a_direction(name: str) -> None:
    """What has none says how a result was made."""
    module = registry.load("fracgen.metrics", name, "metric")
    metric = module.build(module.Settings())
    assert set(metric.columns) - set(metric.higher) <= {"maps", "by_alpha"}
    assert set(metric.higher) <= set(metric.columns)
    assert isinstance(metric.about(), dict)
