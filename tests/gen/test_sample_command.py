"""`python -m fracgen.sample`: samples of fracsim's schema, named by all that shapes them; bad input is refused by name.

The network is random, so that nothing here depends on what a clip shows.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import fracsim.dataset
from fracgen import sample as command
from fracgen.config.model import Model, Vae
from fracgen.config.sample import Generated, SampleConfig, Sampler
from fracgen.data import pictures
from fracgen.sampling import generate, job, networks, records, request, trained_run
from fracsim import codec
from fracsim.dataset import verify as dataset_verify
from fracsim.sample import Sample, read, verify
from tests.command import environment
from tests.gen import sampling_run
from tests.gen.sampling_run import FRAMES, HEIGHT, WIDTH, WORDS, config, write_run


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with runs of stages 1 and 3, a picture, a condition, and a data set."""
    folder = tmp_path_factory.mktemp("place")
    write_run(folder / "stage1-a", streams=("rgb",), stage=1)
    write_run(folder / "stage3-b")
    sampling_run.picture(folder / "tart.png")
    sampling_run.condition(folder / "pull.json")
    sampling_run.clips(folder / "data")
    return folder


@pytest.fixture
def single(place: Path, tmp_path: Path) -> SampleConfig:
    """A picture and a condition, into a folder of its own."""
    return config(place / "stage3-b", tmp_path, image=str(place / "tart.png"), condition=str(place / "pull.json"))


@pytest.fixture
def batch(place: Path, tmp_path: Path) -> SampleConfig:
    """The two clips of the test split, into a folder of its own."""
    return config(place / "stage3-b", tmp_path, data=str(place / "data"))


def sampled(cfg: SampleConfig) -> list[Sample]:
    return [read(folder) for folder in job.run(cfg)]


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


def test_equal_commands_give_equal_samples_bit_for_bit_and_other_seeds_others(
    single: SampleConfig, tmp_path: Path
) -> None:
    (first,) = sampled(single)
    (again,) = sampled(replace(single, output=Generated(folder=str(tmp_path / "again"))))
    (other,) = sampled(replace(single, seed=1))
    assert again.path.name == first.path.name != other.path.name
    for name in ("rgb", *first.maps):
        assert np.array_equal(first.stored(name), again.stored(name))
    assert not np.array_equal(first.rgb, other.rgb)


def test_a_batch_of_two_gives_what_two_single_ones_give(batch: SampleConfig, tmp_path: Path) -> None:
    """Matrix products of two clips may sum in another order: 1e-5 of values near 1, at most one step of 255."""
    alone = sampled(batch)
    together = sampled(replace(batch, batch=2, output=Generated(folder=str(tmp_path / "two"))))
    assert [s.path.name for s in alone] == [s.path.name for s in together]
    assert len(alone) == 2
    for one, other in zip(alone, together, strict=True):
        assert np.abs(one.rgb.astype(int) - other.rgb).max() <= 1
        for name in one.maps:
            assert np.allclose(one.maps[name], other.maps[name], atol=1e-4)
    assert not np.array_equal(alone[0].rgb, alone[1].rgb)


class Counted:
    """Counts calls of networks."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.velocities, self.decoded = 0, 0
        velocity, decode = generate.velocity, networks.FrozenVae.decode

        def counted_velocity(*arguments: Any) -> torch.Tensor:
            self.velocities += 1
            return velocity(*arguments)

        def counted_decode(vae: Any, latent: torch.Tensor) -> torch.Tensor:
            self.decoded += len(latent)
            return decode(vae, latent)

        monkeypatch.setattr(generate, "velocity", counted_velocity)
        monkeypatch.setattr(networks.FrozenVae, "decode", counted_decode)


@pytest.mark.parametrize(("guidance", "passes", "calls"), [(1.0, "sequential", 3), (2.0, "sequential", 6),
                                                           (2.0, "batched", 3)])  # fmt: skip
def test_the_network_is_called_once_a_step_and_twice_with_guidance(
    guidance: float, passes: str, calls: int, single: SampleConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    counted = Counted(monkeypatch)
    sampled(replace(single, sampler=Sampler(solver="unipc", steps=3, guidance=guidance, passes=passes)))
    assert counted.velocities == calls


def test_only_the_maps_that_are_asked_for_are_decoded(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    counted = Counted(monkeypatch)
    (made,) = sampled(replace(single, maps=["damage"]))
    assert list(made.maps) == ["damage"]
    assert counted.decoded == 2
    (bare,) = sampled(replace(single, maps=[]))
    assert list(bare.maps) == []
    assert counted.decoded == 3


def test_a_sample_that_is_there_is_not_made_again_unless_asked_for(
    batch: SampleConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A command that was interrupted after its first clip goes on with the second."""
    counted = Counted(monkeypatch)
    (first,) = sampled(replace(batch, limit=1))
    assert counted.velocities == 2
    both = sampled(batch)
    assert counted.velocities == 4
    assert both[0].path == first.path
    assert len({s.path for s in both}) == 2
    sampled(batch)
    assert counted.velocities == 4
    sampled(replace(batch, output=Generated(folder=batch.output.folder, overwrite=True)))
    assert counted.velocities == 8


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


def test_the_picture_of_a_clip_is_its_first_frame_in_the_size_of_the_run(batch: SampleConfig, place: Path) -> None:
    """Means of 2 x 2 px; the grips lie where the scene has them, scaled alike."""
    run = trained_run.load(batch.run)
    for one in request.requests(batch, run, ()):
        assert one.clip is not None
        frame = one.clip.read("rgb", 0, 1)[0].astype(np.float64)
        means = frame.reshape(HEIGHT, 2, WIDTH, 2, 3).mean(axis=(1, 3))
        assert np.abs(one.read() - means).max() <= 0.5
        assert np.allclose(one.paths, one.condition.paths(FRAMES, WIDTH, HEIGHT), atol=1e-9)  # seen from the front
        assert one.caption == one.clip.row["caption"]


def test_positions_move_with_the_picture_on_its_canvas(single: SampleConfig, place: Path) -> None:
    """96 x 32 on 48 x 32: fitted, it is 48 x 16 px and begins 8 px below the top; cropped, its middle half is left."""
    wide = sampling_run.picture(place / "wide.png", 96, 32)
    given = sampling_run.condition(place / "wide.json", grips=[0.25, 0, 0.75, 1], velocity=[-1, 0.5, 1, 0], fps=25)
    cfg, run = replace(single, image=str(wide), condition=str(given)), trained_run.load(single.run)
    fitted, cropped = (request.of_file(replace(cfg, fit=fit), run) for fit in ("fit", "crop"))
    assert fitted.paths[0].tolist() == [[12, 8], [36, 24]]
    assert cropped.paths[0].tolist() == [[0, 0], [48, 32]]
    assert np.allclose(fitted.paths[-1] - fitted.paths[0], np.array([[-48, 8], [48, 0]]) * 0.04)  # 4 frames at 100 / s
    assert fitted.condition.fps == 100.0


@pytest.mark.parametrize(("stem", "name", "split"), [("tart", "tart", "none"), ("cake", "pictured cake", "none")])
def test_a_picture_is_of_no_split_whatever_its_name(
    stem: str, name: str, split: str, single: SampleConfig, place: Path
) -> None:
    image = sampling_run.picture(place / f"{stem}.png")
    (made,) = sampled(replace(single, image=str(image), maps=[]))
    (row,) = fracsim.dataset.open(made.path.parent).table.to_pylist()
    assert (row["object"], row["split"], row["class"]) == (name, split, "low_stretch")


def test_the_caption_is_that_of_the_condition_or_made_from_it(single: SampleConfig, place: Path) -> None:
    run = trained_run.load(single.run)
    assert request.of_file(single, run).caption == (
        "A tart of a soft material that stretches little is pulled horizontally."
    )
    sampling_run.condition(place / "own.json", caption="A tart tears.", category="high_stretch")
    assert request.of_file(replace(single, condition=str(place / "own.json")), run).caption == "A tart tears."


def test_the_report_says_how_the_luminance_jumps_at_the_start(single: SampleConfig) -> None:
    rgb = np.zeros((3, 2, 2, 3))
    rgb[0], rgb[1] = 0.5, (0.5, 0.6, 0.5)
    found = records.report(rgb, np.full((2, 2, 3), 255, np.uint8))
    assert found == {"luminance_offset": pytest.approx(-0.5), "luminance_jump": pytest.approx(0.1 * 0.7152)}
    assert records.report(rgb[:1], np.zeros((2, 2, 3), np.uint8))["luminance_jump"] == 0
    (made,) = sampled(single)
    luma = made.rgb[:2] / 255 @ records.LUMA
    assert made.meta["report"]["luminance_jump"] == pytest.approx(luma[1].mean() - luma[0].mean(), abs=1 / 255)


def test_another_shift_than_that_of_the_training_is_warned_of(single: SampleConfig) -> None:
    with pytest.warns(UserWarning, match=r"sampler\.shift=1 is not that of the training, 5"):
        (made,) = sampled(replace(single, maps=[], sampler=Sampler(solver="euler", steps=2, shift=1.0)))
    assert made.meta["content"]["sampler"]["shift"] == 1.0


def test_a_latent_that_is_not_finite_is_refused(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate, "velocity", lambda network, x, sigma, inputs: x * float("nan"))
    with pytest.raises(ValueError, match=r"sampler\.dtype=float32: the network gives numbers that are not finite"):
        sampled(single)
    assert not list(Path(single.output.folder).glob("*"))


BAD: dict[str, tuple[Callable[[SampleConfig, Path], SampleConfig], str]] = {
    "no run": (lambda c, p: replace(c, run=""), "run= is empty"),
    "a run that is none": (lambda c, p: replace(c, run=str(p / "data")), r"run=.*data has no trained\.safetensors"),
    "maps of stage 1": (lambda c, p: replace(c, run=str(p / "stage1-a"), maps=["damage"]),
                        r"maps=\[damage\]: run=.*stage1-a is of stage 1 and predicts rgb, not damage"),
    "nothing to sample": (lambda c, p: replace(c, image="", condition=""),
                          r"give image=FILE and condition=FILE, or data"),
    "both kinds": (lambda c, p: replace(c, data=str(p / "data")), r"data, image, condition: give image=FILE and"),
    "no condition": (lambda c, p: replace(c, condition=""), r"condition= is empty: .*give condition=FILE"),
    "no image": (lambda c, p: replace(c, image=""), r"image= is empty: .*give image=FILE"),
    "truth of a picture": (lambda c, p: replace(c, scales="truth"), r"scales=truth needs simulated clips"),
    "a condition that is none": (lambda c, p: replace(c, condition=str(p / "tart.png")),
                                 r"condition=.*tart\.png cannot be"),
    "an image that is none": (lambda c, p: replace(c, image=str(p / "pull.json")),
                              r"image=.*pull\.json cannot be read"),
    "another VAE": (lambda c, p: replace(c, vae=replace(c.vae, seed=1)),
                    r"vae\.path: run=.*stage3-b was trained with vae=\w+, but the one chosen is \w+"),
    "another encoder": (lambda c, p: replace(c, encoders=replace(WORDS, text="umt5")),
                        r"encoders\.text_path= holds no UMT5"),
    "no clip": (lambda c, p: replace(c, image="", condition="", data=str(p / "data"), split="train", objects=["duck"]),
                r"data=.*data holds no clip of split=train and objects=\[duck\]"),
    "no data set": (lambda c, p: replace(c, image="", condition="", data=str(p / "nowhere")),
                    r"nowhere is not a folder"),
    "other base weights": (lambda c, p: replace(c, base=str(p)), r"model\.path|weights"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_refused_by_name(name: str, single: SampleConfig, place: Path) -> None:
    change, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        job.run(change(single, place))
    assert not list(Path(single.output.folder).glob("*/"))


def test_a_device_that_is_not_there_is_refused(single: SampleConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.backends.mps, "is_available", lambda: False)
    with pytest.raises(ValueError, match="device=mps is not there: set device=auto"):
        job.run(replace(single, device="mps"))


def test_embeddings_of_another_width_are_refused(single: SampleConfig, place: Path) -> None:
    cache = {**sampling_run.cache(), "text": "words-64"}
    write_run(place / "stage3-c", cache=cache)
    with pytest.raises(
        ValueError, match=r"encoders\.text: run=.*stage3-c was trained with text=words-64, but .* words-12"
    ):
        job.run(replace(single, run=str(place / "stage3-c")))


def test_a_run_that_does_not_say_how_its_latents_were_made_finds_their_cache(place: Path) -> None:
    folder = place / "latents"
    folder.mkdir()
    (folder / "cache.json").write_text(json.dumps(sampling_run.cache()))
    told = {"data": {"folder": str(folder)}, "loss": {"shift": 3.0}}
    run = trained_run.load(str(write_run(place / "stage3-d", cache={}, config=told)))
    assert (run.size, run.shift) == ((FRAMES, HEIGHT, WIDTH), 3.0)
    (folder / "cache.json").unlink()
    with pytest.raises(
        ValueError, match=r"does not say how its latents were made, and their cache cannot be asked: .*latents"
    ):
        trained_run.load(str(place / "stage3-d"))


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


@pytest.fixture
def line(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run the command line in this process; gives its exit status."""

    def call(*arguments: str) -> int:
        vae: Vae = sampling_run.VAE
        sizes = [f"vae.base_dim={vae.base_dim}", "vae.dim_mult=[1,1,1,1]", f"vae.res_blocks={vae.res_blocks}"]
        monkeypatch.setattr(sys, "argv", ["sample", f"run={place / 'stage3-b'}", "encoders=tiny", "vae=tiny", *sizes,
                                          f"output.folder={tmp_path}", *arguments])  # fmt: skip
        try:
            command.main()
        except SystemExit as end:
            return int(end.code or 0)
        return 0

    return call


def test_the_command_line_samples_and_prints_where(
    line: Callable[..., int], place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = (f"image={place / 'tart.png'}", f"condition={place / 'pull.json'}", "sampler=preview", "sampler.steps=2")
    assert line(*asked, "maps=[damage]") == 0
    folder = Path(capsys.readouterr().out.strip())
    assert folder.parent == tmp_path
    assert read(folder).meta["content"]["sampler"]["solver"] == "unipc"
    assert line(*asked, "maps=[heat]") == 2
    assert "maps=[heat] is not allowed: it must be one of flow, strain" in capsys.readouterr().err
    assert line(*asked, "sampler.solver=heun") == 2
    assert "sampler.solver=heun is not known: choose one of euler, unipc" in capsys.readouterr().err
    assert line(*asked, "smapler.steps=2") == 2
    assert "smapler" in capsys.readouterr().err


def test_a_command_that_is_interrupted_says_how_to_go_on_and_goes_on(
    line: Callable[..., int], place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    """Ctrl-C in the first step of the second clip: the first one is whole, and nothing else is there."""
    asked = (f"data={place / 'data'}", "sampler.steps=2", "maps=[]")
    velocity, calls = generate.velocity, iter(range(100))

    def interrupted(*arguments: Any) -> torch.Tensor:
        if next(calls) == 2:
            raise KeyboardInterrupt
        return velocity(*arguments)

    monkeypatch.setattr(generate, "velocity", interrupted)
    assert line(*asked) == 130
    assert "repeat the command to go on" in capsys.readouterr().err
    (first,) = tmp_path.glob("*")
    assert verify(first) == []
    assert line(*asked) == 0
    assert next(calls) == 2 + 1 + 2  # the two steps of the second clip only
    assert len(list(tmp_path.glob("*"))) == 2


def test_the_presets_are_what_they_are_called() -> None:
    found = {name: command.SAMPLE.compose(f"sampler={name}").sampler for name in command.SAMPLE.groups["sampler"]}
    assert {name: (s.solver, s.steps) for name, s in found.items()} == {
        "preview": ("unipc", 10), "default": ("unipc", 30), "reference": ("euler", 200)}  # fmt: skip
    assert found["default"] == Sampler()
    assert found["reference"].dtype == "float32"
    assert all((s.shift, s.guidance) == (0, 1) for s in found.values())


def test_help_and_errors_need_no_torch() -> None:
    code = "import sys; from fracgen import sample; sample.SAMPLE.compose('seed=3'); print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True)
    assert done.stdout == "False\n", done.stderr


def test_the_model_of_a_run_may_lie_elsewhere(place: Path) -> None:
    run = trained_run.load(str(place / "stage3-b"), "/weights/elsewhere")
    assert run.model == replace(sampling_run.MODEL, path="/weights/elsewhere")
    assert isinstance(trained_run.load(str(place / "stage3-b")).model, Model)
