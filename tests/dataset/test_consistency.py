"""R2_cons against closed forms, and of a small data set."""

import math
from pathlib import Path

import numpy as np
import pytest

from fracsim import dataset
from fracsim.dataset.__main__ import main
from fracsim.dataset.consistency import of_clip, r2_cons, sums


def test_one_linear_law_explains_everything_and_damaged_material_does_not_count() -> None:
    rng = np.random.default_rng(0)
    strain = rng.uniform(0, 1, (4, 8, 8))
    damage = np.where(strain > 0.5, 0.9, 0.0)
    stress = np.where(damage > 0, 0.0, 7e3 * strain)
    assert r2_cons(*sums(stress, strain, damage)) == pytest.approx(1, abs=1e-12)
    assert r2_cons(*sums(stress, strain, 0 * damage)) < 0.5


def test_it_is_the_coefficient_of_determination_of_a_fit_through_zero() -> None:
    rng = np.random.default_rng(1)
    strain, stress = rng.uniform(0, 1, 1000), rng.uniform(0, 1, 1000)
    k = (strain @ stress) / (strain @ strain)
    exact = 1 - ((stress - k * strain) ** 2).sum() / (stress**2).sum()
    assert r2_cons(*sums(stress, strain, np.zeros(1000))) == pytest.approx(exact, rel=1e-12)
    # Independent uniform fields: (1/4)^2 / (1/3)^2, the chance level; its standard deviation is 0.02 here.
    assert exact == pytest.approx(9 / 16, abs=0.06)


def test_without_strain_there_is_none() -> None:
    assert math.isnan(r2_cons(*sums(np.ones(3), np.zeros(3), np.zeros(3))))


def test_a_data_set(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Blocks of frames add up to the whole clip; a clip without the maps is counted, not read."""
    clip = dataset.open(folder).filter(object="duck")[0]
    whole = (clip.read(name) for name in ("stress", "strain", "damage"))
    assert of_clip(clip) == pytest.approx(r2_cons(*sums(*whole)), rel=1e-12)
    assert main(["consistency", str(folder)]) == 0
    out = capsys.readouterr().out
    assert "all" in out
    assert "1 clips lack one of the maps stress, strain, damage" in out
