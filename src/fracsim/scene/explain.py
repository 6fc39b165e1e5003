"""Errors of Hydra and OmegaConf in the words of a program: the field, the value, what is allowed and the way out."""

import shlex
from collections.abc import Sequence
from difflib import get_close_matches

from fracsim.scene.knob import describe, text
from fracsim.scene.quoting import quote


def fields(overrides: Sequence[str]) -> dict[str, str]:
    """Field and value of each override, as written; the last one of a field counts."""
    pairs = (override.lstrip("+~").partition("=") for override in overrides)
    return {field: value for field, _, value in pairs}


def explain(error: Exception, overrides: Sequence[str], schema: type, noun: str, see: str) -> str:
    """What an error about `overrides` means to the user of a program.

    `schema` is the dataclass of its configuration, `noun` what one is called, `see` a sentence that names the help.
    """
    from hydra.errors import MissingConfigException, OverrideParseException
    from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException, ValidationError

    if isinstance(error, OverrideParseException):
        field, _, value = str(error.override).partition("=")
        safe = f'{field}="{value or "#f2e0c0"}"' if '"' not in value else f"{field}={quote(value)}"
        return (f"{error.override} cannot be read: write field=value, as {_example(schema)}; a value with signs like "
                f"# ( ) needs two pairs of quotes, as {shlex.quote(safe)}. {see}")  # fmt: skip
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        group, _, choice = error.missing_cfg_file.rpartition("/")
        return f"{group}={choice} is not known: choose one of {', '.join(error.options or ())}."
    cause = error.__cause__ or error
    if not isinstance(cause, OmegaConfBaseException) or not cause.full_key:
        named = [o for o in overrides if o in str(error)] or overrides
        return f"{' '.join(named)} cannot be used: {' '.join(str(error).split()).rstrip('.')}. {see}"
    field = cause.full_key.partition("[")[0]
    typed = {key: v for key, v in fields(overrides).items() if f"{key}.".startswith(f"{field}.")}
    value = ([*typed.values()] or [""])[-1]
    if isinstance(cause, (ConfigAttributeError, ConfigKeyError)):
        field = ([*typed] or [field])[-1]  # of materal.E the error knows only materal
        return f"{field}={value} is not a field of {_a(noun)}: {_instead(field, schema)} {see}"
    for name, default, knob in describe(schema):
        if name == field and isinstance(cause, ValidationError):
            return knob.refusal(name, value, default)
    inside = [name for name, _, _ in describe(schema) if name.startswith(f"{field}.")]
    if inside and isinstance(cause, ValidationError):
        return (
            f"{field}={value} cannot be used: {field} is a section; set one of its fields, {', '.join(inside)}. {see}"
        )
    return f"{field}={value} cannot be used: {str(cause).splitlines()[0]}. {see}"


def _a(noun: str) -> str:
    """The noun with its article."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _example(schema: type) -> str:
    """An override that can be read: the first number among the fields."""
    return next(
        (f"{name}={text(default)}" for name, default, _ in describe(schema) if type(default) is float), "field=1.5"
    )


def _instead(field: str, schema: type) -> str:
    """What the user who typed `field` may have meant, as a sentence."""
    known = [name for name, _, _ in describe(schema)]
    sections = list(dict.fromkeys(name.rpartition(".")[0] for name in known if "." in name))
    section, _, leaf = field.rpartition(".")
    near = [section] if section in sections else get_close_matches(section, sections, n=1)
    siblings = [name for name in known if near and name.rpartition(".")[0] == near[0]]
    meant = [name for name in siblings + known if name.rpartition(".")[2] == leaf]
    if not meant:
        pool = {name.rpartition(".")[2]: name for name in reversed(siblings or known)}
        pool |= {} if section else {name: name for name in sections}
        meant = [pool[name] for name in get_close_matches(leaf, pool, n=1)]
    if meant:
        return f"did you mean {meant[0]}?"
    return f"choose one of {', '.join(siblings or sorted({name.partition('.')[0] for name in known}))}."
