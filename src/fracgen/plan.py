"""python -m fracgen.plan: what a training takes on a device; exit status 2 when it does not fit."""

import sys
from typing import TYPE_CHECKING

from fracgen.config.plan import PlanConfig
from fracsim import entry
from fracsim.scene.program import Program

if TYPE_CHECKING:
    from rich.table import Table

    from fracgen.memory.devices import Device
    from fracgen.memory.planner import Estimate
    from fracgen.memory.size import Clips

PLAN: Program[PlanConfig] = Program("fracgen.plan", "plan", PlanConfig, optional=("experiment", "debug"))
RESUME = "nothing was changed"
PETA = 1e15


def task(config: PlanConfig) -> None:
    """Print the plan of a configuration; exit status 2 when it does not fit."""
    from rich.console import Console

    from fracgen.memory import planner
    from fracgen.memory.devices import device

    clips, origin = clips_of(config)
    target = device(config.plan.device, config.plan.memory, config.plan.tflops)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 120)
    with console.status("counting"):
        found = [planner.estimate(config, n, clips, target) for n, _ in planner.stages(config)]
        shown = table(config, found, clips, target)
    console.print(heading(config, found, clips, origin, target), shown)
    for one in found:
        if not one.memory.fits:
            entry.complain(planner.refusal(config, one, clips, target))
            sys.exit(entry.BAD)


def clips_of(cfg: PlanConfig) -> "tuple[Clips, str]":
    """The training clips, and where that is known from: a latent cache, or the fields of `plan`."""
    from pathlib import Path

    from fracgen import data
    from fracgen.data.index import ABOUT
    from fracgen.memory.planner import clips_of
    from fracgen.memory.size import Clips

    plan = cfg.plan
    if (Path(cfg.data.folder).expanduser() / ABOUT).is_file():
        cache = data.open(cfg.data.folder)
        numbers = cache.numbers(cfg.data.train_split, cfg.data.objects)[: cfg.data.limit or None]
        return clips_of(cache.about, len(numbers)), f"of data.folder={cfg.data.folder}"
    number = min(plan.clips, cfg.data.limit or plan.clips)
    return Clips(
        plan.width, plan.height, plan.frames, number
    ), f"as plan.* says: data.folder={cfg.data.folder} is empty"


def heading(cfg: PlanConfig, found: "list[Estimate]", clips: "Clips", origin: str, target: "Device") -> str:
    """What the table is about."""
    one = found[-1].weights
    devices = found[-1].devices
    return "\n".join([
        f"{clips.number} clips of {clips.frames} frames, {clips.width} x {clips.height} px ({origin})",
        f"{one.total:,} parameters, of which {one.trained:,} are trained (model.train={cfg.model.train}); "
        f"{found[-1].size.latent[0]} latent frames",
        f"{devices} x {target.name}, {target.flops / 1e12:.3g} TFLOP/s kept up "
        f"({'given' if cfg.plan.tflops else 'assumed'}), base {cfg.trainer.base_dtype}, {cfg.trainer.optimizer}, "
        f"{cfg.trainer.batch} of {cfg.trainer.effective_batch} clips at a time",
    ])  # fmt: skip


def table(cfg: PlanConfig, found: "list[Estimate]", clips: "Clips", target: "Device") -> "Table":
    """A column a stage."""
    from rich.table import Table

    out = Table("", title=f"planned, not measured; hours of all stages: {sum(one.hours for one in found):.3g}")
    for one in found:
        out.add_column(f"stage {one.stage}", justify="right")
    parts = [tokens(found), work(cfg, found), bytes_(found), modes(cfg, found, clips, target)]
    for part in parts:
        for name, values in part.items():
            out.add_row(name, *values)
        out.add_section()
    return out


Rows = dict[str, list[str]]


def tokens(found: "list[Estimate]") -> Rows:
    """Tokens of a clip."""
    return {
        "streams": [str(one.size.streams) for one in found],
        "tokens of a clip": [f"{one.size.tokens:,}" for one in found],
        "  of colour alone": [f"{one.size.tokens // one.size.streams:,}" for one in found],
        "  of the reference": [f"{one.size.reference_tokens:,}" for one in found],
    }


def work(cfg: PlanConfig, found: "list[Estimate]") -> Rows:
    """Operations and time."""
    plan, passes = cfg.plan, 1 + cfg.plan.guided
    step = cfg.trainer.effective_batch
    return {
        "forward, linear layers (PFLOP a clip)": [f"{one.flops.linear / PETA:.4g}" for one in found],
        "forward, attention": [f"{one.flops.attention / PETA:.4g}" for one in found],
        f"computed again (checkpointing={cfg.trainer.checkpointing})": [
            f"{one.flops.recompute / PETA:.4g}" for one in found
        ],
        "backward": [f"{one.flops.backward / PETA:.4g}" for one in found],
        f"optimiser step of {step} clips (PFLOP)": [f"{step * one.flops.total / PETA:.4g}" for one in found],
        "a clip on one device (s)": [f"{one.seconds:.3g}" for one in found],
        "an epoch (h)": [f"{one.epoch_hours:.3g}" for one in found],
        "the stage (h)": [f"{one.hours:.3g}" for one in found],
        f"sampling, {plan.steps} steps of {passes} passes (s a clip)": [
            f"{one.sampling_seconds(plan.steps, passes):.3g}" for one in found
        ],
    }


def bytes_(found: "list[Estimate]") -> Rows:
    """Memory of a device."""
    return {
        "frozen weights (GiB)": gib([one.memory.frozen for one in found]),
        "trained weights": gib([one.memory.trained for one in found]),
        "gradients": gib([one.memory.gradients for one in found]),
        "states of the optimiser": gib([one.memory.states for one in found]),
        "activations kept for the backward pass": gib([one.memory.kept for one in found]),
        "  on top of them inside a block": gib([one.memory.inside for one in found]),
        "context and libraries": gib([one.memory.reserve for one in found]),
        "sum": gib([one.memory.total for one in found]),
        "the device has": gib([one.memory.capacity for one in found]),
        "fits": ["yes" if one.memory.fits else "no" for one in found],
    }


def modes(cfg: PlanConfig, found: "list[Estimate]", clips: "Clips", target: "Device") -> Rows:
    """The sum by mode of checkpointing."""
    from fracgen.memory.budget import memory
    from fracgen.memory.remedies import Case

    out = {}
    for mode in ("none", "selective", "full"):
        cases = [Case(cfg, one.streams, clips).trainer(checkpointing=mode).cfg for one in found]
        pairs = zip(cases, found, strict=True)
        out[f"sum with checkpointing={mode}"] = gib(
            [memory(case, one.streams, one.size, target).total for case, one in pairs]
        )
    return out


def gib(sizes: list[int]) -> list[str]:
    """Bytes in GiB."""
    from fracgen.memory.devices import GIB

    return [f"{size / GIB:.3g}" for size in sizes]


def main() -> None:
    """Entry point; exit status 2 after an error or when the training does not fit, 130 after Ctrl-C or SIGTERM."""
    entry.launch(PLAN, task, RESUME)


if __name__ == "__main__":
    main()
