"""The report: one page of tables and pictures, written only from what a study has left on disk."""

import platform
import subprocess
from pathlib import Path

import torch

from fracgen.evaluation.report import save
from fracgen.laptop import clips, sheets, tables
from fracgen.laptop.running import Journal
from fracgen.laptop.steps import steps
from fracgen.laptop.study import STAGES, Study, Variant

WARNING = """Two caveats bind all figures. Stages follow one another, so that stage 2 has seen twice the steps of stage
1, and stage 3 three times; only stage 3 and its control have seen equally many. And the held-out clips are few, so that
a Frechet distance is mostly bias: compare it with others of equal n only."""


def write(study: Study, path: Path) -> Path:
    """Write the page, its pictures and nothing else; raises ValueError when a part of the study is lacking."""
    found = tables.scores(study)
    pictures = path.parent / ("img" if path.parent.name == "docs" else "")
    rows = clips.pulls(study.path("controlled"), study.path("controlled_generated", "seed0/stage3"))
    parts = [
        "# The laptop study: results",
        about(study),
        WARNING,
        f"## The ablation\n\nHeld-out objects; the mean of {study.seeds} seed(s), with the least and the most.\n\n"
        + tables.ablation(found),
        "## Directions\n\nSeeds in which the second of two trainings is better than the first, and whether it is in "
        "the paper.\n\n" + tables.directions(found),
        "## The pull\n\n" + tables.follows(rows) + "\n\n" + tables.pulls(rows),
        *drawn(study, path, pictures),
        "## The generator against the simulator\n\nScores against the finest solver, on held-out clips; the scenes are "
        "those of the study, 96 x 96 px and 21 frames.\n\n" + tables.comparison(study),
        times(study),
    ]
    save(path, "\n\n".join(parts) + "\n")
    return path


def about(study: Study) -> str:
    """The command, the commit and the machine."""
    commit = subprocess.run(["git", "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=False)
    seconds = sum(entry["seconds"] for step in steps(study) if (entry := Journal(study.folder / "steps").read(step)))
    return (f"`python -m fracgen.laptop --seeds {study.seeds} --steps {study.steps}`, commit "
            f"{commit.stdout.strip() or 'unknown'}, {processor()}, torch {torch.__version__}: {seconds / 60:.0f} "
            "minutes. [laptop.md](laptop.md) says what is done.")  # fmt: skip


def processor() -> str:
    """The model of the processor."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} x {names[0]}" if names else platform.processor() or platform.machine()


def drawn(study: Study, path: Path, folder: Path) -> list[str]:
    """Contact sheets of each stage and of the controlled pulls, as parts of the page."""
    truth, made = study.path("controlled"), study.path("controlled_generated", "seed0/stage3")
    wanted = [("pull", truth, made, "Controlled pulls, stage 3")]
    for stage in STAGES:
        place = study.path("generated", Variant(f"stage{stage}", stage, 0).place)
        wanted.append((f"stage{stage}", study.path("clips"), place, f"Held-out clips, stage {stage}"))
    out = []
    for name, true, generated, title in wanted:
        file = sheets.sheet(clips.both(true, generated), folder / f"laptop_{name}.png")
        out.append(f"![{title}: true above, generated below; colour, then damage]"
                   f"({file.relative_to(path.parent).as_posix()})")  # fmt: skip
    return out


def times(study: Study) -> str:
    """What each step took."""
    journal = Journal(study.folder / "steps")
    rows = [[step.name, step.about, f"{step.minutes:g}", f"{entry['seconds'] / 60:.1f}"]
            for step in steps(study) if (entry := journal.read(step))]  # fmt: skip
    return "## Time\n\n" + tables.markdown(["step", "", "expected, min", "took, min"], rows)
