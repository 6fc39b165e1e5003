"""From YAML files and the command line to a validated `Scene`."""

from pathlib import Path
from typing import Any

from fracsim.knob import describe
from fracsim.vocab import Scene

HEADER = """Pull an object until it tears and film it, with pixel-aligned maps of flow, strain, stress and damage.

  python -m fracsim                                    a loaf of bread, into outputs/
  python -m fracsim asset=duck loading.axis_deg=30     a built-in rubber duck
  python -m fracsim asset=mesh asset.path=FILE.glb material=rubber fracture=rubber
  python -m fracsim asset=ply asset.path=point_cloud.ply
  python -m fracsim -m material.E=2e3,6e3              several scenes in one process

Choices of whole groups (asset=duck):
$APP_CONFIG_GROUPS
"""


def folder() -> Path:
    """The folder of YAML files: inside the installed package, or at the top of a checkout."""
    packaged = Path(__file__).parent / "conf"
    return packaged if packaged.is_dir() else Path(__file__).parents[2] / "conf"


def knobs() -> str:
    """A table of every field of a scene: name, default, range, meaning."""
    rows = []
    for name, default, knob in describe(Scene):
        allowed = " ".join(part for part in (knob.allowed(), knob.unit) if part)
        shown = f"{name}={default if default != '' else chr(34) * 2}"
        rows.append(f"  {shown:<44} {knob.doc}" + (f"  {{{allowed}}}" if allowed else ""))
    return "\n".join(rows)


def register() -> None:
    """Make the schema and the help text known to Hydra."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    store.store(name="scene", node=Scene)
    text = f"{HEADER}\nFields (built-in defaults; a chosen group may set others; {{allowed values}}):\n{knobs()}\n"
    store.store(
        group="hydra/help",
        name="fracsim",
        node={"app_name": "fracsim", "header": "", "footer": "", "template": _escape(text)},
    )


def _escape(text: str) -> str:
    """Text in which Hydra's template engine replaces only $APP_CONFIG_GROUPS."""
    return text.replace("$", "$$").replace("$$APP_CONFIG_GROUPS", "$APP_CONFIG_GROUPS")


def scene(cfg: Any) -> Scene:
    """The validated scene of a composed configuration; raises ValueError for a value out of range."""
    from omegaconf import OmegaConf

    out = OmegaConf.to_object(cfg)
    assert isinstance(out, Scene)
    return out


def compose(*overrides: str) -> Scene:
    """The scene that `python -m fracsim OVERRIDES...` runs; for use from Python."""
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir

    register()
    with initialize_config_dir(str(folder()), version_base="1.3"):
        return scene(hydra_compose("simulate", overrides=list(overrides)))
