"""Metrics of generated clips: one file each, named as in `conf/metric`.

A module has `build(**fields)`, which returns a `metric.Metric`, and a dataclass of these fields.
"""
