"""The steps of the study, in order, each a list of commands that can be typed one by one."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from fracgen.laptop import cost
from fracgen.laptop.study import (
    FRAMES,
    FULL,
    METRICS,
    OF_SETS,
    PRESETS,
    SHOWN_OBJECTS,
    SIMULATORS,
    STAGES,
    THRESHOLDS,
    WIDTH,
    Study,
    Variant,
)  # fmt: skip

Command = tuple[str, ...]
"""A module and its arguments: what follows `python -m`."""


@dataclass(frozen=True)
class Step:
    """One step; it is finished when all its commands were."""

    name: str
    about: str
    commands: tuple[Command, ...]
    minutes: float
    """Expected on two idle cores."""
    together: bool = True
    """Whether its commands may run at the same time, one a core; else each takes all cores."""
    enough: Callable[[], str] | None = None
    """For a command that may fail in part: says what is lacking, or nothing."""


def steps(study: Study) -> list[Step]:
    """All steps but the last, which writes tables and sheets in this process."""
    return [*_data(study), *_trainings(study), *_samples(study), *_scores(study), *_comparison(study)]


# Data


def _data(study: Study) -> Iterator[Step]:
    """Clips, the VAE, latents."""
    clips, vae = study.path("clips"), study.path("vae")
    first, last = study.train_draws, study.train_draws + study.test_draws
    yield Step(
        "simulate",
        "clips of all objects, those of the held-out ones with draws of their own",
        (
            simulation(clips, study.train_objects, f"draw=range(0,{first})"),
            simulation(clips, study.test_objects, f"draw=range({first},{last})"),
        ),
        cost.minutes(
            cost.simulated(study, len(study.train_objects), study.train_draws)
            + cost.simulated(study, len(study.test_objects), study.test_draws)
        ),
        together=False,
        enough=lambda: lacking(clips, study.least),
    )
    yield Step("vae", "the small VAE, and the error of its reconstructions", (
        ("fracgen.train_vae", f"data={clips}", f"clips={study.vae_clips}", "held_out=6" if study.vae_clips > 8 else
         "held_out=2", f"steps={study.vae_steps}", f"output.folder={vae}"),
    ), cost.minutes(cost.CORES * cost.vae(study)))  # fmt: skip
    yield Step("encode", "latents of all clips, so that training needs no VAE", (
        ("fracgen.encode", f"data={clips}", *networks(study), f"width={WIDTH}", f"height={WIDTH}", f"frames={FRAMES}",
         f"output.folder={study.path('latents')}"),
    ), cost.minutes(cost.CORES * (cost.START + total(study) * cost.ENCODED)))  # fmt: skip


def simulation(folder: str, objects: Sequence[str], *more: str) -> Command:
    """A sweep over objects in two processes."""
    return ("fracsim", "+sweep=laptop", f"asset={','.join(objects)}", *more, "hydra/launcher=joblib",
            "hydra.launcher.n_jobs=2", f"output.folder={folder}")  # fmt: skip


def networks(study: Study) -> Command:
    """What encodes and decodes."""
    return ("vae=tiny", f"vae.path={study.path('vae')}", "encoders=tiny")


def total(study: Study) -> int:
    """Clips of the data set."""
    return len(study.train_objects) * study.train_draws + cost.held_out(study)


def lacking(folder: str, least: int) -> str:
    """Why the clips in a folder are too few; nothing when they do."""
    import fracsim.dataset

    found = len(fracsim.dataset.open(folder)) if Path(folder).is_dir() else 0
    return "" if found >= least else f"{folder} holds {found} clips that can be used, and at least {least} are needed"


# Trainings


def _trainings(study: Study) -> Iterator[Step]:
    """The stages in turn, the seeds side by side."""
    about = {1: "colour", 2: "colour and maps, from stage 1",
             3: "with the constitutive loss, and without as control, from stage 2"}  # fmt: skip
    for stage, words in about.items():
        mine = tuple(training(study, variant) for variant in study.variants if variant.stage == stage)
        yield Step(
            f"train{stage}", f"stage {stage}: {words}", mine, cost.minutes(len(mine) * cost.trained(study, stage))
        )


def training(study: Study, variant: Variant) -> Command:
    """One training; the control starts from the same run of stage 2 as stage 3 does."""
    control = variant.name == "control"
    before = study.run(Variant("stage2", 2, variant.seed))
    return ("fracgen.train", "+experiment=laptop", f"stage={variant.stage}", f"seed={variant.seed}",
            f"model.seed={variant.seed}", f"data.folder={study.path('latents')}",
            *(f"stages.stage{k}.steps={study.steps}" for k in STAGES if study.steps != FULL.steps),
            *(("loss.lambda_const=0", f"init_from={before}") if control else ()),
            f"output.folder={study.path(variant.run)}")  # fmt: skip


# Samples and scores


def _samples(study: Study) -> Iterator[Step]:
    """The held-out clips, as each run generates them, and controlled pulls."""
    data, clips = study.path("clips"), cost.held_out(study)
    yield Step("sample", "the held-out clips by each run", tuple(
        sampling(study, variant, data, study.path("generated", variant.place)) for variant in study.variants
    ), cost.minutes(sum(cost.sampled(clips, variant.stage) for variant in study.variants)))  # fmt: skip
    controlled = study.path("controlled")
    axes = f"loading.axis_deg={','.join(map(str, study.angles))}"
    yield Step("pull", "two held-out objects, simulated along some axes with early and with late thresholds", (
        simulation(controlled, SHOWN_OBJECTS, "draw=-1", axes, f"fracture={','.join(THRESHOLDS.values())}",
                   "loading.speed=0.9", "loading.offset=0.15"),
    ), cost.minutes(cost.simulated(study, len(SHOWN_OBJECTS), len(THRESHOLDS) * len(study.angles))), together=False,
        enough=lambda: lacking(controlled, 4))  # fmt: skip
    yield Step("pull_generated", "the same pulls, generated by stage 3", tuple(
        sampling(study, variant, controlled, study.path("controlled_generated", variant.place))
        for variant in study.variants if variant.name == "stage3"
    ), cost.minutes(study.seeds * cost.sampled(cost.pulls(study), 3)))  # fmt: skip


def sampling(study: Study, variant: Variant, data: str, folder: str, preset: str = "default") -> Command:
    """The held-out clips of a data set, generated by a run."""
    return ("fracgen.sample", f"run={study.run(variant)}", f"data={data}", f"sampler={preset}", *networks(study),
            "batch=4", f"output.folder={folder}")  # fmt: skip


def _scores(study: Study) -> Iterator[Step]:
    """Scores of all runs; what they are read against is observed once."""
    yield Step("evaluate", "scores of each run on the held-out clips", tuple(
        evaluation(study, study.path("generated", variant.place), study.path("clips"), variant.place,
                   controls="[truth,static,axis]" if variant == Variant("stage3", 3, 0) else "[]")
        for variant in study.variants
    ), cost.minutes(len(list(study.variants)) * cost.scored(cost.held_out(study))))  # fmt: skip


def evaluation(
    study: Study, pred: str, gt: str, place: str, controls: str = "[]", metrics: Sequence[str] = METRICS
) -> Command:
    """Scores of the clips in a folder."""
    return ("fracgen.evaluate", f"pred={pred}", f"gt={gt}", f"metric=[{','.join(metrics)}]", f"controls={controls}",
            "by=[class,object]", f"output.folder={study.path('scores', place)}")  # fmt: skip


# The generator against the simulator


def _comparison(study: Study) -> Iterator[Step]:
    """Some held-out clips by finer solvers, and scores of all against the finest."""
    draws = f"draw=range({study.train_draws},{study.train_draws + study.compared_draws})"
    truth = study.path("simulator", study.solvers[-1])
    yield Step("solvers", "a few held-out clips by each solver", tuple(
        simulation(study.path("simulator", name), study.test_objects, draws, *SIMULATORS[name])
        for name in study.solvers
    ), cost.minutes(sum(cost.simulated(study, len(study.test_objects), study.compared_draws, name)
                        for name in study.solvers)), together=False, enough=lambda: lacking(truth, 1))  # fmt: skip
    compared = len(study.test_objects) * study.compared_draws
    made, metrics = Variant("stage3", 3, 0), [name for name in METRICS if name not in OF_SETS]
    yield Step("samplers", "the same clips by the generator with each preset", tuple(
        sampling(study, made, truth, study.path("sampler", name), name) for name in PRESETS
    ), cost.minutes(len(PRESETS) * cost.sampled(compared, 3)))  # fmt: skip
    yield Step("compare", "scores of both against the finest solver", (
        *(evaluation(study, study.path("simulator", name), truth, f"simulator/{name}", metrics=metrics)
          for name in study.solvers[:-1]),
        *(evaluation(study, study.path("sampler", name), truth, f"sampler/{name}", metrics=metrics)
          for name in PRESETS),
    ), cost.minutes((len(study.solvers) - 1 + len(PRESETS)) * cost.scored(compared)))  # fmt: skip
