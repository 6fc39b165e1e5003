"""The figures that the paper prints: Table 1, the ablation over stages, the baselines before and after fine-tuning."""

from collections.abc import Mapping
from typing import NamedTuple


class Column(NamedTuple):
    """A figure of the paper, and the result of ours that stands for it."""

    title: str
    metric: str
    result: str
    higher: bool


FVD = Column("FVD", "fvd", "fvd", False)
LPIPS = Column("LPIPS", "lpips", "lpips", False)
PSNR = Column("PSNR", "psnr", "psnr", True)
SAC = Column("SAC", "sac", "sac", True)
QUALITY = (FVD, LPIPS, PSNR, SAC)
DPA = Column("DPA", "dpa", "dpa", True)
R2_CONS = Column("R2_cons", "r2_cons", "r2_cons", True)
MAPS = (
    *(Column(f"MSE {name}", "map_mse", f"mse_{name}", False) for name in ("flow", "stress", "strain", "damage")),
    Column("MSE overall", "map_mse", "mse", False),
)
ABLATED = (*QUALITY, DPA, *MAPS, R2_CONS)
BESIDE = (
    Column("SSIM", "ssim", "ssim", True),
    Column("ST-LPIPS", "stlpips", "stlpips", False),
    Column("KVD", "kvd", "kvd", False),
)
"""Results that the paper does not print."""

FRACGEN = "FracGen"
TABLE_1: Mapping[str, tuple[float, ...]] = {
    "ForcePrompting-FT": (933.21, 0.29, 15.93, 0.092),
    "PhyCo-FT": (832.12, 0.33, 14.18, 0.434),
    "CogVideoX-5B-I2V-FT": (1533.21, 0.32, 14.12, 0.432),
    FRACGEN: (266.17, 0.15, 21.19, 0.946),
}
"""Figures in the order of QUALITY."""
BASELINES: Mapping[str, tuple[float, ...]] = {
    "ForcePrompting": (1226.32, 0.32, 15.07, 0.075),
    "ForcePrompting-FT": (933.21, 0.29, 15.93, 0.092),
    "PhyCo": (1595.01, 0.38, 12.51, 0.415),
    "PhyCo-FT": (832.12, 0.33, 14.18, 0.434),
    "CogVideoX-5B-I2V": (1844.92, 0.34, 13.78, 0.470),
    "CogVideoX-5B-I2V-FT": (1533.21, 0.32, 14.12, 0.432),
}
"""Figures in the order of QUALITY."""
NO_MAPS = None
STAGES: Mapping[str, tuple[float | None, ...]] = {
    "Stage 1": (298.04, 0.1555, 20.73, 0.9460, NO_MAPS, NO_MAPS, NO_MAPS, NO_MAPS, NO_MAPS, NO_MAPS, NO_MAPS),
    "Stage 2": (289.65, 0.1550, 20.82, 0.9393, 0.438, 0.03735, 0.01464, 0.02017, 0.02904, 0.02530, 0.378),
    "Stage 3": (266.17, 0.1502, 21.19, 0.9462, 0.536, 0.01147, 0.00429, 0.02681, 0.02740, 0.01749, 0.902),
}
"""Figures in the order of ABLATED; stage 1 has no maps."""
R2_TRUTH = 0.948
"""R2_cons of the true maps."""
CLIPS = 2808
"""Clips of the paper's test set."""
