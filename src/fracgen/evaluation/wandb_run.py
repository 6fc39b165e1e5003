"""The results as a run of wandb: numbers, a table with a row a clip, and the pictures; all of it is on disk too.

It is offline unless WANDB_API_KEY or WANDB_MODE say otherwise; `wandb sync FOLDER/wandb/offline-run-*` uploads later.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fracgen.config.evaluate import EvaluateConfig
from fracgen.evaluation import plots
from fracgen.evaluation.table import label


def numbers(document: Mapping[str, Any]) -> dict[str, float]:
    """Every defined result by its name, as eval/sac and eval/object/star/sac."""
    out: dict[str, float] = {}
    for metric, entry in document["metrics"].items():
        groups = {f"{group}/{value}/": found for group, some in entry["by"].items() for value, found in some.items()}
        for place, found in {"": entry, **groups}.items():
            out |= {f"eval/{place}{label(metric, column)}": one["value"]
                    for column, one in found["results"].items() if one["value"] is not None}  # fmt: skip
        out[f"eval/n/{metric}"] = entry["n"]
    return out


def log(folder: Path, document: Mapping[str, Any], clips: Sequence[Mapping[str, str]], cfg: EvaluateConfig) -> None:
    """Log a finished evaluation; raises ValueError without the package."""
    try:
        import wandb
    except ModuleNotFoundError:
        raise ValueError("logger=wandb needs the package wandb: pip install 'fracsim[watch]', or set logger=none."
                         ) from None  # fmt: skip
    mode: Any = os.environ.get("WANDB_MODE") or ("online" if os.environ.get("WANDB_API_KEY") else "offline")
    with wandb.init(project=cfg.project, job_type="fracgen.evaluate", dir=str(folder), mode=mode,
                    config={"run": document["run"], "settings": document["settings"]}) as run:  # fmt: skip
        columns: list[str | int] = list(dict.fromkeys(name for row in clips for name in row))
        table = wandb.Table(columns=columns, data=[[row.get(str(name), "") for name in columns] for row in clips])
        pictures = {f"plots/{path.stem}": wandb.Image(str(path)) for path in plots.files(folder)}
        run.log({**numbers(document), **pictures, "clips": table})
