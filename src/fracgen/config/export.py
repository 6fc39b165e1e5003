"""The schema of `python -m fracgen.export`."""

from dataclasses import dataclass

from fracsim.scene.knob import check, knob

DIFFUSERS, COMFYUI, MERGED = "diffusers", "comfyui", "merged"


@dataclass(kw_only=True)
class ExportConfig:
    """What a training has made, in a form that other programs read."""

    run: str = knob("", "folder of a finished training, as runs/stage3-ID")
    naming: str = knob(DIFFUSERS, "the adapter as diffusers names it, or as ComfyUI and DiffSynth do; or the whole "
                       "model with the adapter merged into it, in the layout of the release",
                       choices=(DIFFUSERS, COMFYUI, MERGED))  # fmt: skip
    output: str = knob("", "file (merged: folder) to write; empty = in the folder of the run")
    dtype: str = knob(
        "float32", "floating-point type; float32 loses nothing", choices=("float32", "bfloat16", "float16")
    )
    base: str = knob("", "folder of the base weights (merged), if they have moved since the training")

    def __post_init__(self) -> None:
        check(self, "")
