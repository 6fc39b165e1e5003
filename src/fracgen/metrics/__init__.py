"""Metrics of clips: one file each, chosen by name with `metric=[psnr,sac]`; each has a file in `conf/metric`.

A module has `Settings`, a dataclass of its fields, and `build(settings)`, which returns a `fracgen.evaluation.metric`
Metric or raises ValueError for what cannot be used, `MissingWeightsError` for weights that lie nowhere.
"""

NEEDED = ("Settings", "build")
