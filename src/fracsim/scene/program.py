"""Programs that are configured by the YAML files in conf/: from files and the command line to a validated object."""

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, make_dataclass
from functools import cached_property
from itertools import takewhile
from pathlib import Path
from typing import Any, Generic, TypeVar

from fracsim.scene import effect, explain, plugins, space
from fracsim.scene.knob import check_names, describe, text
from fracsim.scene.manual import manual
from fracsim.scene.quoting import quoted
from fracsim.scene.vocab import Scene

T = TypeVar("T")


def conf() -> Path:
    """The folder of YAML files of all programs: inside the installed package, or at the top of a checkout."""
    packaged = Path(__file__).parents[1] / "conf"
    return packaged if packaged.is_dir() else Path(__file__).parents[3] / "conf"


@dataclass(frozen=True)
class Program(Generic[T]):
    """A command, the primary file of its configuration, and the dataclass that a configuration becomes.

    The primary file says the rest. The comment at its top begins the help. Its defaults list names the schema (`scene`
    for Scene, `train_config` for TrainConfig), the groups of the program, and `override hydra/help: PRIMARY`. With the
    group `space` the program also has the field `draw`.
    """

    name: str
    """What follows `python -m`."""
    primary: str
    """Name of the primary file in `folder`, without .yaml."""
    schema: type[T]
    """Dataclass whose fields are knobs or dataclasses of knobs."""
    folder: Path = conf()
    optional: tuple[str, ...] = ()
    """Groups that are not in the defaults list: chosen by +GROUP=CHOICE."""
    plugins: tuple[str, ...] = ()
    """Groups of which several choices count at once; the field of such a group is a mapping, a section a choice."""
    check: Callable[[T, Collection[str]], None] | None = None
    """Raises ValueError for an object with fields, set by hand, that do not go together."""

    @property
    def noun(self) -> str:
        """What one object of the schema is called, as `train config`."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", self.schema.__name__).lower()

    @cached_property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """The groups in the defaults list of the primary file, and the files of each, sorted."""
        from omegaconf import OmegaConf

        content: Any = OmegaConf.to_container(OmegaConf.load(self.folder / f"{self.primary}.yaml"))
        entries = [key for entry in content.get("defaults", []) if isinstance(entry, dict) for key in entry]
        named = [key.rpartition(" ")[2].partition("@")[0].strip("/") for key in entries if "override " not in key]
        return {name: self._choices(name) for name in sorted(named)}

    @cached_property
    def config(self) -> type:
        """Schema of a composed configuration: that of the program and, with the group `space`, draw and space."""
        if "space" not in self.groups:
            return self.schema
        return make_dataclass(self.schema.__name__, [], bases=(space.Draw, self.schema))

    def register(self, *, with_help: bool = False) -> None:
        """Make the schema known to Hydra, and the text of --help where it is wanted."""
        from hydra.core.config_store import ConfigStore

        store = ConfigStore.instance()
        store.store(name=self.noun.replace(" ", "_"), node=self.config)
        template = self.manual().replace("$", "$$") if with_help else ""
        node = {"app_name": self.name, "header": "", "footer": "", "template": template}
        store.store(group="hydra/help", name=self.primary, node=node)

    def register_file(self, path: Path, overrides: Sequence[str] = ()) -> str:
        """Make a resolved configuration, as scene.yaml of a sample, the primary one; returns the name that it gets.

        It sets every field, so that no group is chosen. Raises ValueError for an override that chooses one, and for a
        file that is no mapping.
        """
        from hydra.core.config_store import ConfigStore
        from omegaconf import OmegaConf
        from omegaconf.errors import OmegaConfBaseException
        from yaml import YAMLError

        for field, value in explain.fields(overrides).items():
            if field in self.groups and value in self.groups[field]:
                raise ValueError(f"{field}={value} cannot be used with {path}, which sets every field of {field}: "
                                 "set single fields, as in --help.")  # fmt: skip
        primary: Any = OmegaConf.to_container(OmegaConf.load(self.folder / f"{self.primary}.yaml"))
        entries = primary.pop("defaults", [])
        kept = [e for e in entries if not isinstance(e, dict) or any("override " in key for key in e)]
        try:
            content: Any = OmegaConf.to_container(OmegaConf.load(path))
        except (OSError, ValueError, YAMLError, OmegaConfBaseException) as error:
            raise ValueError(f"{path} cannot be read as YAML: {' '.join(str(error).split())}") from None
        if not isinstance(content, dict):
            raise ValueError(f"{path} is not a {self.noun}: it holds no fields.")
        ConfigStore.instance().store(name=f"{self.primary}_file", node={**primary, **content, "defaults": kept})
        return f"{self.primary}_file"

    def manual(self) -> str:
        """The text of --help."""
        from omegaconf import OmegaConf

        lines = (self.folder / f"{self.primary}.yaml").read_text(encoding="utf-8").splitlines()
        about = "\n".join(line[2:] for line in takewhile(lambda line: line.startswith("#"), lines))
        values = OmegaConf.to_container(self.composed(()), resolve=True)
        more = {name: self._choices(name) for name in self.optional}
        return manual(about, self.noun, self.groups, self.config, values, more)

    def compose(self, *overrides: str) -> T:
        """The object that `python -m NAME OVERRIDES...` works on; for use from Python, also inside a Hydra program.

        Raises ValueError naming the override that cannot be used.
        """
        return self.resolve(self.composed(overrides), overrides)

    def resolve(self, cfg: Any, overrides: Sequence[str] = ()) -> T:
        """The validated object of a configuration composed with `overrides`; `draw` and `space` are used up.

        Raises ValueError for a key or a value that is not allowed.
        """
        from omegaconf import OmegaConf
        from omegaconf.errors import OmegaConfBaseException

        given = explain.fields(overrides)
        try:
            # Composing lets +key=value pass; merging into the schema does not.
            content: Any = OmegaConf.to_container(cfg, resolve=True)
            drawn = space.take(content, given) if "space" in self.groups else {}
            overrides = [*overrides, *(f"{field}={text(value)}" for field, value in drawn.items())]
            out = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(self.schema), content))
        except OmegaConfBaseException as error:
            raise ValueError(self.explain(error, overrides)) from None
        assert isinstance(out, self.schema)
        check_names(out)
        if self.check is not None:
            self.check(out, given)
        return out

    def check_deleted(self, overrides: Sequence[str]) -> None:
        """Raise ValueError for an override that deletes a field or a section: its default would come back unseen."""
        names = [f"{name}." for name, _, _ in describe(self.config)]
        for field in (o[1:].partition("=")[0] for o in overrides if o.startswith("~")):
            if any(name.startswith(f"{field}.") for name in names):
                raise ValueError(f"~{field} cannot be used: every {self.noun} has {field}; leave it out for its "
                                 f"default, or set it. See python -m {self.name} --help.")  # fmt: skip

    def check_plugins(self, overrides: Sequence[str]) -> None:
        """Raise ValueError for an override of a field that no chosen section of a group in `plugins` has."""
        from omegaconf import OmegaConf

        for group in self.plugins:
            plugins.check_names(overrides, group)
        single = [o for o in overrides if o.partition("=")[0].partition(".")[0].lstrip("~") in self.plugins and "." in
                  o.partition("=")[0]]  # fmt: skip
        if not single:
            return
        content: Any = OmegaConf.to_container(OmegaConf.load(self.folder / f"{self.primary}.yaml"))
        for override in single:
            group = override.lstrip("~").partition(".")[0]
            default = next((e[group] for e in content["defaults"] if isinstance(e, dict) and group in e), ())
            plugins.check(override, self.folder / group, plugins.chosen(overrides, group, default),
                          f"See python -m {self.name} --help.")  # fmt: skip

    def explain(self, error: Exception, overrides: Sequence[str]) -> str:
        """What an error of Hydra or OmegaConf about `overrides` means: the field, the value and the way out."""
        from hydra.errors import MissingConfigException

        if isinstance(error, MissingConfigException) and error.missing_cfg_file and not error.options:
            group = error.missing_cfg_file.rpartition("/")[0]  # Hydra names no options where several count
            error.options = list(self._choices(group))
        return explain.explain(error, overrides, self.config, self.noun, f"See python -m {self.name} --help.")

    def _choices(self, group: str) -> tuple[str, ...]:
        """The files of a group, sorted."""
        return tuple(sorted(p.stem for p in (self.folder / group).glob("*.yaml")))

    def composed(self, overrides: Sequence[str], *, hydra: bool = False, primary: str = "") -> Any:
        """The configuration as Hydra composes it, with Hydra's own part on request; raises ValueError.

        `primary` is a name from `register_file`.
        """
        from hydra import compose, initialize_config_dir
        from hydra.errors import HydraException

        self.check_deleted(overrides)
        self.check_plugins(overrides)
        with _hydra_alone():
            self.register()
            with initialize_config_dir(str(self.folder), version_base="1.3"):
                try:
                    return compose(primary or self.primary, overrides=quoted(overrides), return_hydra_config=hydra)
                except (HydraException, ValueError) as error:
                    raise ValueError(self.explain(error, overrides)) from None


@contextmanager
def _hydra_alone() -> Iterator[None]:
    """A Hydra without state; the state that a Hydra program around this one has set up comes back afterwards."""
    from copy import deepcopy

    from hydra.core.config_store import ConfigStore
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.plugins import Plugins
    from hydra.version import VersionBase

    Plugins.instance()  # their schemas go into the store that stays
    store, hydra, base = ConfigStore.instance(), GlobalHydra.instance().hydra, VersionBase.instance().version_base
    repo = store.repo
    store.repo = deepcopy(repo)
    GlobalHydra.instance().clear()
    try:
        yield
    finally:
        GlobalHydra.instance().hydra, store.repo = hydra, repo
        VersionBase.instance().version_base = base


SIMULATE: Program[Scene] = Program("fracsim", "simulate", Scene, optional=("sweep",), check=effect.check)
"""`python -m fracsim`."""
compose = SIMULATE.compose
