"""From YAML files and the command line to a validated `Scene`."""

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from fracsim.scene.knob import describe
from fracsim.scene.manual import manual
from fracsim.scene.vocab import Scene

HELP = "See python -m fracsim --help."


def folder() -> Path:
    """The folder of YAML files: inside the installed package, or at the top of a checkout."""
    packaged = Path(__file__).parents[1] / "conf"
    return packaged if packaged.is_dir() else Path(__file__).parents[3] / "conf"


def register(shown: Scene | None = None) -> None:
    """Make the schema and the help text, with the values of the scene `shown`, known to Hydra."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    store.store(name="scene", node=Scene)
    template = manual(folder(), shown).replace("$", "$$") if shown else ""
    node = {"app_name": "fracsim", "header": "", "footer": "", "template": template}
    store.store(group="hydra/help", name="fracsim", node=node)


def scene(cfg: Any, overrides: Sequence[str] = ()) -> Scene:
    """The validated scene of a configuration composed with `overrides`.

    Raises ValueError for a key or a value that is not allowed.
    """
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        # Composing lets +key=value pass; merging into the schema does not.
        merged = OmegaConf.merge(OmegaConf.structured(Scene), OmegaConf.to_container(cfg, resolve=True))
        out = OmegaConf.to_object(merged)
    except OmegaConfBaseException as error:
        raise ValueError(explain(error, overrides)) from None
    assert isinstance(out, Scene)
    return out


def compose(*overrides: str) -> Scene:
    """The scene that `python -m fracsim OVERRIDES...` runs; for use from Python.

    Raises ValueError naming the override that cannot be used.
    """
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException

    register()
    with initialize_config_dir(str(folder()), version_base="1.3"):
        try:
            return scene(hydra_compose("simulate", overrides=list(overrides)), overrides)
        except HydraException as error:
            raise ValueError(explain(error, overrides)) from None


def explain(error: Exception, overrides: Sequence[str]) -> str:
    """What an error of Hydra or OmegaConf about `overrides` means here: the field, the value and the way out."""
    from hydra.errors import MissingConfigException, OverrideParseException
    from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

    if isinstance(error, OverrideParseException):
        return (f"{error.override} cannot be read: write field=value, as material.E=2e3; a value with signs like # ( ) "
                f"""needs two pairs of quotes, as 'asset.interior="#f2e0c0"'. {HELP}""")  # fmt: skip
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        group, _, choice = error.missing_cfg_file.rpartition("/")
        return f"{group}={choice} is not known: choose one of {', '.join(error.options or ())}."
    cause = error.__cause__ or error
    if not isinstance(cause, OmegaConfBaseException) or not cause.full_key:
        named = [o for o in overrides if o in str(error)] or overrides
        return f"{' '.join(named)} cannot be used: {' '.join(str(error).split()).rstrip('.')}. {HELP}"
    field = cause.full_key.partition("[")[0]
    pairs = (o.lstrip("+~").partition("=") for o in overrides)
    value = ([v for key, _, v in pairs if f"{key}.".startswith(f"{field}.")] or [""])[-1]
    if isinstance(cause, (ConfigAttributeError, ConfigKeyError)):
        return f"{field}={value} is not a field of a scene: {_instead(field)} {HELP}"
    for name, default, knob in describe(Scene):
        if name == field and isinstance(cause, ValidationError):
            return knob.refusal(name, value, default)
    return f"{field}={value} cannot be used: {str(cause).splitlines()[0]}. {HELP}"


def _instead(field: str) -> str:
    """What somebody who typed `field` may have meant."""
    known = {name: name.rpartition(".")[2] for name, _, _ in describe(Scene)}
    section, _, leaf = field.rpartition(".")
    siblings = [name for name in known if section and name.startswith(f"{section}.")]
    alike = [leaf, *get_close_matches(leaf, [known[name] for name in siblings or known], n=1)]
    near = [name for a in alike for name in known if known[name] == a]
    if near:
        return f"did you mean {near[0]}?"
    return f"choose one of {', '.join(siblings or sorted({name.partition('.')[0] for name in known}))}."
