"""CoTracker3, offline model (Karaev et al. 2024), from a checkout and a checkpoint on disk. Nothing is downloaded.

Not run by this project's tests, which have no weights: only what is around the network is tested. The checkout is
github.com/facebookresearch/co-tracker (CC BY-NC 4.0), the checkpoint scaled_offline.pth of
huggingface.co/facebook/cotracker3.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fracgen.evaluation.clip import Clip
from fracgen.evaluation.tracker import Tracker
from fracgen.evaluation.weights import Weights, sha256
from fracsim.records import Array
from fracsim.scene.knob import check, knob

WEIGHTS = Weights(
    title="CoTracker3, scaled_offline.pth", field="tracker.cotracker3.checkpoint", variable="FRACGEN_COTRACKER3",
    size="about 100 MB", source="fetch scaled_offline.pth from huggingface.co/facebook/cotracker3",
)  # fmt: skip


@dataclass(kw_only=True)
class Settings:
    """Where code and weights are."""

    repo: str = knob("", "folder of a checkout of github.com/facebookresearch/co-tracker, which has hubconf.py")
    checkpoint: str = knob("", "file scaled_offline.pth; empty = FRACGEN_COTRACKER3")
    device: str = knob("auto", "where it runs", choices=("auto", "cpu", "cuda", "mps"))

    def __post_init__(self) -> None:
        check(self, "tracker.cotracker3")


def build(settings: Settings) -> Tracker:
    """The tracker; raises ValueError without the checkout, MissingWeightsError without the checkpoint."""
    repo = Path(settings.repo).expanduser()
    if not settings.repo or not (repo / "hubconf.py").is_file():
        raise ValueError(f"tracker.cotracker3.repo={settings.repo} is no checkout of CoTracker: git clone "
                         "https://github.com/facebookresearch/co-tracker and give its folder.")  # fmt: skip
    checkpoint = WEIGHTS.find(settings.checkpoint)
    return CoTracker3(settings, checkpoint, *_load(repo, checkpoint, settings.device))


def _load(repo: Path, checkpoint: Path, where: str) -> tuple[Any, Any]:
    """The predictor with its weights, and the device it is on."""
    import torch

    gpu = "cuda" if torch.cuda.is_available() else "cpu"
    device = torch.device(gpu if where == "auto" else where)
    predictor = torch.hub.load(str(repo), "cotracker3_offline", source="local", pretrained=False)  # type: ignore[no-untyped-call]
    weights = torch.load(checkpoint, map_location="cpu", weights_only=True)
    predictor.model.load_state_dict(weights)
    return predictor.to(device).eval(), device


@dataclass(frozen=True)
class CoTracker3:
    """Tracks all queries at once, with all frames in view."""

    settings: Settings
    checkpoint: Path
    predictor: Any
    device: Any

    def __call__(self, clip: Clip, queries: Array, t0: int, t1: int) -> tuple[Array, Array]:
        """Tracks (t1 - t0 + 1, N, 2) of queries (N, 2), and what is seen."""
        import torch

        video = torch.from_numpy(np.ascontiguousarray(clip.rgb)).permute(0, 3, 1, 2)[None].float().to(self.device)
        # It has the centre of the first pixel at (0, 0).
        points = np.concatenate([np.full((len(queries), 1), float(t0)), queries - 0.5], axis=1)
        with torch.inference_mode():
            tracks, visible = self.predictor(video, queries=torch.from_numpy(points).float()[None].to(self.device))
        window = slice(t0, t1 + 1)
        return tracks[0, window].double().cpu().numpy() + 0.5, visible[0, window].bool().cpu().numpy()

    def about(self) -> dict[str, Any]:
        """Settings and the hash of the weights."""
        return {"tracker": "cotracker3", **asdict(self.settings), "sha256": sha256(self.checkpoint)}
