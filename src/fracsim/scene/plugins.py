"""Groups of which several choices count at once, as `metric=[psnr,sac]`: each choice is a section of its own."""

from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any


def fields(file: Path) -> tuple[str, ...]:
    """The fields that the file of a choice sets."""
    from omegaconf import OmegaConf

    content: Any = OmegaConf.to_container(OmegaConf.load(file), resolve=False)
    return tuple(str(name) for name in content or ())


def check(override: str, folder: Path, chosen: Sequence[str], see: str) -> None:
    """Raise ValueError for an override GROUP.CHOICE.FIELD=VALUE whose choice or field is not there.

    `folder` has a file for each choice of the group, `chosen` are those that count.
    """
    field = override.lstrip("~").partition("=")[0]
    group, choice, name = (*field.split(".", 2), "")[:3]
    known = sorted(path.stem for path in folder.glob("*.yaml"))
    if choice not in known:
        raise ValueError(f"{override} cannot be used: {group} has no {choice}, only {', '.join(known)}"
                         f"{_near(choice, known)}; the fields of one from outside are set by +{field}=VALUE. {see}"
                         )  # fmt: skip
    if choice not in chosen:
        every = ",".join([*chosen, choice])
        raise ValueError(f"{override} cannot be used: {choice} is not chosen; choose it by {group}=[{every}]. {see}")
    names = fields(folder / f"{choice}.yaml")
    if name and name not in names:
        raise ValueError(f"{override} cannot be used: {group}.{choice} has the fields {', '.join(names) or '(none)'}"
                         f"{_near(name, names)}. {see}")  # fmt: skip


def check_names(overrides: Sequence[str], group: str) -> None:
    """Raise ValueError where a file is chosen: those are named elsewhere."""
    files = [name for name in chosen(overrides, group, ()) if name.endswith(".py")]
    if files:
        raise ValueError(f"{group}=[{','.join(files)}] cannot be used: give files from outside as "
                         f"outside=[{','.join(files)}].")  # fmt: skip


def chosen(overrides: Sequence[str], group: str, default: Any) -> list[str]:
    """The choices of a group: those of the last override of it, or the default ones."""
    values = [o.partition("=")[2] for o in overrides if o.partition("=")[0] == group]
    if values:
        return [part.strip(" '\"") for part in values[-1].strip("[]").split(",") if part.strip()]
    return [default] if isinstance(default, str) else list(default or ())


def _near(name: str, known: Sequence[str]) -> str:
    """The known name that may have been meant, as the end of a sentence."""
    found = get_close_matches(name, known, n=1)
    return f" (did you mean {found[0]}?)" if found else ""
