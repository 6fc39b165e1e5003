"""python -m fracgen.dashboard: a ready workspace of wandb, for a sweep of simulations or for trainings.

Its specification is JSON, as wandb stores it; with a key it is saved to the project, and its address is printed.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

SWEEP_AXIS, TRAIN_AXIS = "sweep/done", "trainer/global_step"
STATUSES = ("complete", "never_breaks", "suspect", "failed", "interrupted", "existing")
"""What comes of a clip of a sweep."""
LINES, MEDIA, TABLE = "lines", "media", "table"
"""Kinds of panels."""
SCORES = {
    "PSNR, dB": "psnr",
    "SSIM": "ssim",
    "error of the maps": "mse",
    "R2_cons": "r2_cons",
    "DPA": "dpa",
    "SAC": "sac",
}
"""Results of the metrics that a training measures by default, and their titles."""
PARTS = {"PSNR": "psnr_.*", "SSIM": "ssim_.*", "errors of maps": "((mse|epe)_.*|maps)", "elastic law": "r2_.*",
         "damage": "dpa_.*", "axis": "sac_.*",
         "clips, and those for which a value is undefined": "count/.*"}  # fmt: skip
"""What else they say, as regular expressions."""


class Panel(NamedTuple):
    """A panel: lines over the axis of the workspace, pictures and videos, or a table; `pattern` is a regular
    expression of further lines, as a curve an object."""

    title: str
    keys: tuple[str, ...]
    kind: str = LINES
    logarithmic: bool = False
    pattern: str = ""


class Part(NamedTuple):
    """A section of a workspace."""

    title: str
    panels: tuple[Panel, ...]


def sweep() -> list[Part]:
    """What `fracsim.run.logger` logs with logger=wandb."""
    phases = ("prepare", "simulate", "render", "write")
    facts = ("seconds", "frames", "break_frame", "particles", "substeps")
    return [
        Part("progress", (
            Panel("clips by status", tuple(f"sweep/{name}" for name in STATUSES)),
            Panel("seconds since the start", ("sweep/seconds",)),
            Panel("seconds left", ("sweep/seconds_left",)),
        )),
        Part("seconds by phase", (
            *(Panel(name, (f"seconds/{name}",)) for name in phases),
            Panel("all phases", tuple(f"seconds/{name}" for name in phases)),
        )),
        Part("clips", tuple(Panel(name.replace("_", " "), (f"clip/{name}",)) for name in facts)),
        Part("pictures", (
            Panel("at the break", ("clip/thumbnail",), MEDIA),
            Panel("previews", ("clip/preview",), MEDIA),
        )),
        Part("table", (Panel("clips", ("clips",), TABLE),)),
    ]  # fmt: skip


def train(videos: Sequence[str] = ()) -> list[Part]:
    """What `fracgen.training` logs with logger.kind=wandb; `videos` are names of validation clips."""
    from fracgen.layout import STREAMS
    from fracgen.training.meter import LABELS

    def by_level(title: str, key: str) -> Panel:
        return Panel(title, tuple(f"{key}{label}" for label in LABELS))

    shown = [Part("videos", tuple(Panel(name, (f"video/{name}",), MEDIA) for name in videos))] if videos else []
    return [
        *shown,
        Part("losses", (
            Panel("training", ("loss/total", "loss/matching"), logarithmic=True),
            Panel("training by stream", tuple(f"loss/{name}" for name in STREAMS), logarithmic=True),
            Panel("validation", ("val/loss/total", "val/loss/matching"), logarithmic=True),
            Panel("validation by stream", tuple(f"val/loss/{name}" for name in STREAMS), logarithmic=True),
        )),
        Part("metrics of sampled clips", (
            *(Panel(title, (), pattern=f"^val/([^/]+/)?{name}$") for title, name in SCORES.items()),
            Panel("clips", ("val/clips",), TABLE),
        )),
        Part("metrics, further results", tuple(Panel(t, (), pattern=f"^val/{p}$") for t, p in PARTS.items())),
        Part("losses by noise level", (
            by_level("training", "loss/sigma"),
            by_level("validation", "val/loss/sigma"),
            *(by_level(f"validation, {name}", f"val/loss/{name}/sigma") for name in STREAMS),
            by_level("share of the noise levels that were drawn", "sigma"),
        )),
        Part("constitutive loss", (
            Panel("loss", ("loss/const", "val/loss/const"), logarithmic=True),
            Panel("its weight", ("loss/const_weight",)),
            Panel("its share of the loss", ("loss/const_share",)),
            Panel("gate", ("gate/mean", "gate/std", "val/gate/mean", "val/gate/std")),
        )),
        Part("optimiser", (
            Panel("learning rates", ("lr", "lr_const")),
            Panel("norm of the gradient", ("grad_norm",), logarithmic=True),
            Panel("norms of weights", ("norm/trained", "norm/lora_B", "norm/const_maps")),
            Panel("epoch", ("epoch",)),
        )),
        Part("speed", (
            Panel("clips a second", ("speed/clips_per_s",)),
            Panel("tokens a second", ("speed/tokens_per_s",)),
            Panel("share of waiting for data", ("speed/data_wait",)),
            Panel("peak memory, GB", ("memory/peak_gb",)),
        )),
        Part("pictures", (
            Panel("luminance of frame 1 less that of frame 0", ("video/luminance_jump", "video/luminance_jump_true")),
        )),
    ]  # fmt: skip


def keys(parts: Sequence[Part]) -> list[str]:
    """All names that a workspace shows."""
    return [key for part in parts for panel in part.panels for key in panel.keys]


def patterns(parts: Sequence[Part]) -> list[str]:
    """All regular expressions of names that a workspace shows."""
    return [panel.pattern for part in parts for panel in part.panels if panel.pattern]


def workspace(parts: Sequence[Part], name: str, axis: str, entity: str, project: str) -> Any:
    """The workspace of wandb; raises ValueError when its package is missing."""
    try:
        ws: Any = import_module("wandb_workspaces.workspaces")
    except ImportError:
        raise ValueError(
            "fracgen.dashboard needs the package wandb-workspaces: pip install 'fracsim[watch]'."
        ) from None
    sections = [
        ws.Section(name=part.title, is_open=k < 3, panels=[_panel(panel, axis) for panel in part.panels])
        for k, part in enumerate(parts)
    ]
    # Panels of further names, as of videos and metrics, come by themselves.
    return ws.Workspace(entity=entity, project=project, name=name, sections=sections, auto_generate_panels=True)


def _panel(panel: Panel, axis: str) -> Any:
    wr: Any = import_module("wandb_workspaces.reports.v2")
    if panel.kind == MEDIA:
        return wr.MediaBrowser(title=panel.title, media_keys=list(panel.keys))
    if panel.kind == TABLE:
        return wr.WeavePanelSummaryTable(table_name=panel.keys[0])
    return wr.LinePlot(title=panel.title, x=axis, y=list(panel.keys), log_y=panel.logarithmic or None,
                       metric_regex=panel.pattern or None)  # fmt: skip


def specification(space: Any) -> dict[str, Any]:
    """The JSON that wandb stores of a workspace."""
    found: dict[str, Any] = json.loads(space._to_model().model_dump_json(by_alias=True, exclude_none=True))
    return found


def videos_of(run: Path) -> list[str]:
    """Names of the clips that a training has shown; raises ValueError when there are none."""
    found = sorted({path.stem for path in run.glob("videos/step-*/*.mp4")})
    if not found:
        raise ValueError(f"--run={run} has no videos (videos/step-*/*.mp4): give the folder of a training with "
                         "logger.videos > 0, or leave --run out.")  # fmt: skip
    return found


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.dashboard", description=__doc__)
    parser.add_argument(
        "what", choices=("sweep", "train"), help="sweep: python -m fracsim; train: python -m fracgen.train"
    )
    parser.add_argument("--project", default="", help="project of wandb (WANDB_PROJECT, or fracsim or fracgen)")
    parser.add_argument("--entity", default=os.environ.get("WANDB_ENTITY", ""), help="user or team (WANDB_ENTITY)")
    parser.add_argument(
        "--run", type=Path, metavar="FOLDER", help="a training whose videos are shown in an own section"
    )
    parser.add_argument(
        "--to", type=Path, metavar="FILE", help="write the specification there and save nothing to wandb"
    )
    return parser.parse_args(argv)


def make(options: argparse.Namespace) -> None:
    """Write the specification, print it, or save it to the project; raises ValueError."""
    sweeping = options.what == "sweep"
    if sweeping and options.run:
        raise ValueError(f"--run={options.run} belongs to train: leave it out.")
    parts = sweep() if sweeping else train(videos_of(options.run) if options.run else ())
    project = options.project or os.environ.get("WANDB_PROJECT") or ("fracsim" if sweeping else "fracgen")
    axis = SWEEP_AXIS if sweeping else TRAIN_AXIS
    online = os.environ.get("WANDB_API_KEY") and not options.to
    if online and not options.entity:
        raise ValueError("--entity is missing: give the user or team of wandb that the project belongs to.")
    space = workspace(parts, f"{project}: {options.what}", axis, options.entity, project)
    if online:
        space.save()
        print(space.url)
        return
    content = json.dumps(specification(space), indent=1) + "\n"
    if not options.to:
        print(content, end="")
        return
    options.to.parent.mkdir(parents=True, exist_ok=True)
    unfinished = options.to.with_name(f".{options.to.name}.part")
    unfinished.write_text(content, encoding="utf-8")
    os.replace(unfinished, options.to)
    print(options.to)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; exit status 2 after an error."""
    from fracsim import entry

    try:
        make(arguments(argv))
    except (ValueError, OSError) as error:
        entry.complain(str(error))
        return entry.BAD
    return 0


if __name__ == "__main__":
    sys.exit(main())
