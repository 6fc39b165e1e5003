"""A stored map is the quantity times its coverage; over alpha it is the quantity, also at the edges of a tear."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fracsim import Camera, Capture, Fracture, Loading, Material, Output, Scene, Solver, sample
from fracsim.records import Array
from fracsim.sample.coverage import FAINT, over_alpha
from tests.sim.bars import bar
from tests.sim.bars import scene as one_thread

from .recording import Clip

LEVEL = 0.51 / 65535
"""Half a step of 16 bits, and the rounding of codes in float32."""


@pytest.fixture(scope="module")
def torn(taichi: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[sample.Sample, Array]:
    """The sample of a bar that has just parted, and the part of failed material in what each pixel shows, (H, W)."""
    from fracsim.render.film import Film
    from fracsim.solve.simulator import Simulator

    pulled = one_thread(
        material=Material(law="fixed_corotated", E=2e3, nu=0.3),
        fracture=Fracture(onset=1.2, crit=1.4),
        loading=Loading(speed=1.0),
        solver=Solver(cells=40),
        camera=Camera(width=128, height=64, half_width=0.6),
        capture=Capture(frames=20),
    )
    simulator = Simulator(pulled, bar(pulled.solver))
    *_, last = simulator.frames()
    shown = replace(pulled, capture=Capture(frames=1, tracks=0, strip=False, report=False),
                    output=Output(folder=str(tmp_path_factory.mktemp("torn"))))  # fmt: skip
    film = Film(shown)
    picture = film.shoot(last, simulator.particles)
    with sample.Writer(sample.header_of(shown), shown.output) as writer:
        writer.add(0, picture.rgb, picture.alpha, picture.maps)
        path = writer.finish()
    failed, alpha, _ = film.splat(last, simulator.particles, last.failed[:, None])
    return sample.read(path), failed[..., 0] / np.maximum(alpha, 1e-6)


def test_at_a_torn_edge_stored_damage_is_low_and_damage_over_alpha_is_one(torn: tuple[sample.Sample, Array]) -> None:
    clip, failed = torn
    alpha = clip.alpha[0]
    edge = (failed > 1 - 1e-6) & (alpha >= FAINT) & (alpha < 0.99)  # d = 1 of all that the pixel shows
    assert edge.sum() > 50
    stored, divided = (maps["damage"][0][edge, 0] for maps in (clip.maps, clip.maps_over_alpha))
    np.testing.assert_allclose(stored, alpha[edge], atol=2 * LEVEL)  # Eq. 6 with a constant: d alpha
    assert 1 - stored.mean() > 0.18
    np.testing.assert_allclose(divided, 1, atol=2 * LEVEL / FAINT)


@pytest.mark.parametrize("name", Capture().maps)
def test_over_alpha_is_zero_where_faint_and_the_quotient_elsewhere(torn: tuple[sample.Sample, Array], name) -> None:
    clip, _ = torn
    alpha, stored, divided = clip.alpha[0], clip.maps[name][0], clip.maps_over_alpha[name][0]
    assert divided.dtype == np.float32
    assert divided.shape == stored.shape
    assert ((alpha > 0) & (alpha < FAINT)).any()
    assert (divided[alpha < FAINT] == 0).all()
    seen = alpha >= FAINT
    np.testing.assert_allclose(divided[seen] * alpha[seen, None], stored[seen], rtol=3e-7)


def test_a_quantity_that_is_constant_comes_back_to_the_last_digits() -> None:
    rng = np.random.default_rng(0)
    alpha = rng.random((3, 8, 9)).astype(np.float32)
    back = over_alpha(np.float32([2.5, -7]) * alpha[..., None], alpha)
    seen = alpha >= FAINT
    np.testing.assert_allclose(back[seen], np.tile([2.5, -7], (seen.sum(), 1)), rtol=3e-7)  # two roundings of float32
    assert (back[~seen] == 0).all()


def test_frames_of_both_kinds_are_those_of_the_whole(scene: Scene, record: Callable[[Scene], Path]) -> None:
    clip = sample.read(record(scene))
    assert list(clip.maps_over_alpha) == list(clip.maps)
    np.testing.assert_array_equal(clip.read("flow", 1, 3, over_alpha=True), clip.maps_over_alpha["flow"][1:3])
    np.testing.assert_array_equal(clip.read("flow", 1, 3), clip.maps["flow"][1:3])
    for what in ("rgb", "alpha"):  # no maps: nothing to divide
        np.testing.assert_array_equal(clip.read(what, 1, 3, over_alpha=True), clip.read(what, 1, 3))


def test_without_alpha_every_pixel_counts_as_covered(tmp_path: Path, clip: Clip) -> None:
    header = sample.Header(
        producer="toy", version="1", content={}, document={}, width=64, height=48, frames=1, fps=10.0,
        rgb=False, alpha=False, strip=False, maps={"heat": sample.MapInfo("heat", "K", 1)},
    )  # fmt: skip
    with sample.Writer(header, Output(folder=str(tmp_path))) as writer:
        writer.add(0, None, None, {"heat": clip.maps["strain"][1]})
        made = sample.read(writer.finish())
    np.testing.assert_array_equal(made.maps_over_alpha["heat"], made.maps["heat"])
