"""Sampled clips on disk: samples of fracsim's schema, named by all that shapes them, with the values of their maps.

The network is random, so that nothing here depends on what a clip shows.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import fracsim.dataset
from fracgen.config.sample import Generated, SampleConfig, Sampler
from fracgen.data import pictures
from fracgen.sampling import generate, job, networks, records, request, trained_run
from fracsim import codec
from fracsim.dataset import verify as dataset_verify
from fracsim.sample import verify
from tests.gen import sampling_run
from tests.gen.sampling_run import (  # noqa: F401
    FRAMES,
    HEIGHT,
    WIDTH,
    batch_fixture,
    place_fixture,
    sampled,
    single_fixture,
    write_run,
)


def test_a_picture_and_a_condition_become_a_sample_of_fracsims_schema(single: SampleConfig) -> None:
    (made,) = sampled(single)
    assert verify(made.path) == []
    assert (made.producer, made.frames, made.meta["fps"]) == ("fracgen", FRAMES, 100.0)
    assert made.rgb.shape == (FRAMES, HEIGHT, WIDTH, 3)
    assert {name: (value.shape[-1], made.meta["maps"][name]["unit"]) for name, value in made.maps.items()} == {
        "flow": (2, "1"), "strain": (1, "1"), "stress": (1, "1"), "damage": (1, "1")}  # fmt: skip
    assert all(np.isfinite(value).all() and np.abs(value).max() <= 1 for value in made.maps.values())
    assert (made.path / "strip.mp4").stat().st_size > 0
    assert made.document["config"]["seed"] == 0
    assert made.document["condition"]["E"] == 6000.0
    assert made.document["run"]["stage"] == 3
    assert set(made.meta["seconds"]) == {"sample", "decode"}


def test_a_data_set_of_generated_clips_lists_object_class_and_material(single: SampleConfig, place: Path) -> None:
    folder = Path(single.output.folder)
    sampled(single)
    sampled(replace(single, image="", condition="", data=str(place / "data"), split="all", limit=2))
    rows = {row["object"]: row for row in fracsim.dataset.open(folder).table.to_pylist()}
    assert rows["tart"]["class"] == "low_stretch"
    assert (rows["tart"]["split"], rows["tart"]["loading_axis_deg"], rows["tart"]["loading_speed"]) == ("none", 0, None)
    simulated = [row for row in fracsim.dataset.open(place / "data").table.to_pylist() if row["object"] in rows]
    assert len(simulated) == 2
    for theirs in simulated:
        mine = rows[theirs["object"]]
        same = ("class", "split", "material_law", "material_E", "material_nu", "fracture_onset", "fracture_crit",
                "loading_axis_deg", "loading_speed", "loading_offset")  # fmt: skip
        assert {name: mine[name] for name in same} == {name: theirs[name] for name in same}
        assert mine["producer"].startswith("fracgen ")
        assert mine["status"] == "complete"
    assert fracsim.dataset.open(folder).filter(split="test", material_E=6000.0)[0].read("damage", 0, 1).shape[-1] == 1


def test_fracsim_verifies_a_folder_of_generated_clips(batch: SampleConfig) -> None:
    made = sampled(batch)
    assert all(verify(sample.path) == [] for sample in made)
    folder = made[0].path.parent
    fracsim.dataset.open(folder)  # writes the table
    assert dataset_verify.check(folder) == []


def test_maps_have_the_values_of_their_colours(single: SampleConfig) -> None:
    """The decoded video of a map is what fracsim.codec shows; FFV1 with 16 bits keeps 1 / 65535 of the range."""
    (made,) = sampled(single)
    run = trained_run.load(single.run)
    asked = [request.of_file(single, run)]
    there = networks.load(asked, single, run, "float32", torch.device("cpu"))
    given, _ = networks.inputs(asked, there, run, "warn")
    x = generate.initial(given, 0, [""])
    latent = generate.sample(there.transformer, x, given, generate_levels(), solver="euler")
    for name, video in networks.decode(latent, ("rgb", "flow", "damage"), there.vae, run):
        if name == "rgb":
            assert np.abs(made.rgb / 255 - video).max() <= 0.5 / 255 + 1e-6
        else:
            expected = codec.decode(video, 1.0, made.meta["maps"][name]["channels"])
            assert np.allclose(made.maps[name], expected, atol=2 / 65535)


def test_numbers_enter_with_the_gain_of_the_training(single: SampleConfig) -> None:
    run = trained_run.load(single.run)
    asked = [request.of_file(single, run)]
    there = networks.load(asked, single, run, "float32", torch.device("cpu"))
    loud = replace(run, about=run.about | {"conditioning": run.about["conditioning"] | {"gain": 3.0}})
    given, louder = (networks.inputs(asked, there, one, "warn")[0].channels for one in (run, loud))
    assert torch.equal(louder[:, 16:22], 3 * given[:, 16:22])
    assert torch.equal(louder[:, :16], given[:, :16])


def generate_levels() -> torch.Tensor:
    """Two steps with a shift of 5: 1, 5/6, 0."""
    return torch.tensor([1, 5 / 6, 0], dtype=torch.float64)


def test_the_scale_of_the_simulated_clip_gives_values_in_units(batch: SampleConfig, place: Path) -> None:
    unit = {s.meta["content"]["clip"]: s for s in sampled(batch)}
    truth = {s.meta["content"]["clip"]: s for s in sampled(replace(batch, scales="truth"))}
    encoding = trained_run.load(batch.run).encoding(str(place / "data"), ["rgb"])
    for clip in fracsim.dataset.open(place / "data").filter(split="test"):
        mine = truth[clip.row["id"]]
        assert {name: entry["unit"] for name, entry in mine.meta["maps"].items()} == {
            "flow": "m/s", "strain": "1", "stress": "Pa", "damage": "1"}  # fmt: skip
        for name in mine.maps:
            scale = pictures.video(clip, name, encoding).scale
            assert scale == (1.0 if name == "damage" else mine.meta["maps"][name]["scale"])
            assert np.allclose(mine.maps[name], scale * unit[clip.row["id"]].maps[name], atol=3e-5 * scale)


def test_the_report_says_how_the_luminance_jumps_at_the_start(single: SampleConfig) -> None:
    rgb = np.zeros((3, 2, 2, 3))
    rgb[0], rgb[1] = 0.5, (0.5, 0.6, 0.5)
    found = records.report(rgb, np.full((2, 2, 3), 255, np.uint8))
    assert found == {"luminance_offset": pytest.approx(-0.5), "luminance_jump": pytest.approx(0.1 * 0.7152)}
    assert records.report(rgb[:1], np.zeros((2, 2, 3), np.uint8))["luminance_jump"] == 0
    (made,) = sampled(single)
    luma = made.rgb[:2] / 255 @ records.LUMA
    assert made.meta["report"]["luminance_jump"] == pytest.approx(luma[1].mean() - luma[0].mean(), abs=1 / 255)


def test_the_picture_can_be_put_in_place_of_the_first_frame(single: SampleConfig) -> None:
    """Then the first frame is the picture as the VAE gives it back, whatever the network says."""
    sampler = Sampler(solver="euler", steps=2, overwrite_first_latent=True)
    (made,) = sampled(replace(single, maps=[], sampler=sampler))
    run = trained_run.load(single.run)
    asked = request.of_file(single, run)
    there = networks.load([asked], single, run, "float32", torch.device("cpu"))
    clip = torch.from_numpy(asked.read() / np.float32(255)).movedim(-1, 0)[None, :, None]
    back = there.vae.decode(there.vae.encode(clip))[0, :, 0].movedim(0, -1).numpy()
    assert np.abs(made.rgb[0] / 255 - back).max() < 1.5 / 255


@pytest.mark.parametrize("train", ["lora", "full"])
def test_the_network_computes_in_the_type_that_is_asked_for(train: str, single: SampleConfig, place: Path) -> None:
    """Also where all weights were trained, in float32. bfloat16 has 8 bits: values near 1 move by a few 2^-8."""
    run = write_run(place / f"stage3-{train}", train=train)
    base = replace(single, run=str(run), maps=["damage"])
    exact, rough = (replace(base, sampler=Sampler(solver="euler", steps=2, dtype=d)) for d in ("float32", "bfloat16"))
    source = trained_run.load(str(run))
    there = networks.load([], rough, source, "bfloat16", torch.device("cpu"))
    kinds = {name: p.dtype for name, p in there.transformer.named_parameters()}  # type: ignore[attr-defined]
    assert all(kind == torch.bfloat16 for name, kind in kinds.items() if "attn1.to_q" in name or "proj_out" in name)
    assert kinds["scale_shift_table"] == torch.float32
    (one,), (other,) = sampled(exact), sampled(rough)
    assert one.path != other.path
    assert 0 < np.abs(one.maps["damage"] - other.maps["damage"]).max() < 0.1


def test_what_does_not_shape_a_sample_does_not_rename_it(single: SampleConfig, place: Path) -> None:
    run = trained_run.load(single.run)

    def name(cfg: SampleConfig) -> str:
        sampler = job._sampler(cfg, run, torch.device("cpu"))
        return records.identity(request.of_file(cfg, run), records.Made(cfg, run, run.maps(cfg.maps), sampler))

    same = [replace(single, batch=4), replace(single, device="cpu"), replace(single, output=Generated(folder="x")),
            replace(single, sampler=Sampler(solver="euler", steps=2, passes="batched", shift=5.0))]  # fmt: skip
    assert {name(cfg) for cfg in same} == {name(single)}
    sampling_run.condition(place / "other.json", E=7e3)
    others = [replace(single, seed=3), replace(single, maps=["damage"]),
              replace(single, condition=str(place / "other.json")),
              replace(single, sampler=Sampler(solver="unipc", steps=2)),
              replace(single, sampler=Sampler(solver="euler", steps=2, guidance=2.0))]  # fmt: skip
    assert len({name(single), *map(name, others)}) == 1 + len(others)
