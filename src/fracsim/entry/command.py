"""From `python -m PROGRAM ARGUMENTS` to an exit status, with every error explained in one line."""

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn, TypeVar

# Let Hydra's errors arrive in main(), which explains them.
os.environ.setdefault("HYDRA_FULL_ERROR", "1")

from fracsim.entry.interrupt import Interrupt, interrupted
from fracsim.scene.program import Program
from fracsim.scene.quoting import quoted
from fracsim.version import __version__

T = TypeVar("T")
PACKAGES = tuple(f"{Path(__file__).parents[2] / name}{os.sep}" for name in ("fracsim", "fracgen"))
"""Where the code of these packages lies."""
BAD, INTERRUPTED = 2, 130
"""Exit statuses."""


def complain(message: str) -> None:
    """Print one clear error."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr, flush=True)


def warn_plainly() -> None:
    """Print warnings of these packages as one line for users, without the place in the code; others as Python does."""
    other = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], filename: str, *rest: Any, **more: Any) -> None:
        if category is UserWarning and filename.startswith(PACKAGES):
            print(f"warning: {' '.join(str(message).split())}", file=sys.stderr, flush=True)
        else:
            other(message, category, filename, *rest, **more)

    warnings.showwarning = show


def launch(program: Program[T], task: Callable[[T], Any], resume: str) -> None:
    """Run `task` on the configuration of the command line, in a multirun on each; exit statuses as those of `main`.

    A ValueError or OSError of one job is told, and the others go on.
    """
    import hydra

    failed, process = [], os.getpid()

    def job(config: Any) -> None:
        from hydra.core.hydra_config import HydraConfig
        from omegaconf import OmegaConf

        overrides: Any = OmegaConf.to_container(HydraConfig.get().overrides.task, resolve=False)
        try:
            task(program.resolve(config, overrides))
        except (ValueError, OSError) as error:
            if interrupted():
                raise KeyboardInterrupt from error
            complain(_told(error))
            failed.append(error)
            if os.getpid() != process:  # a worker, whose list nobody reads
                raise

    main(
        program,
        hydra.main(config_path=str(program.folder), config_name=program.primary, version_base="1.3")(job),
        resume,
    )
    if failed:
        sys.exit(BAD)


def _told(error: Exception) -> str:
    """What an error means to the user."""
    if isinstance(error, OSError):
        return f"{error}: free some space or set output.folder to a folder you may write to, then repeat the command"
    return str(error)


def main(program: Program[Any], run: Callable[[], Any], resume: str) -> None:
    """Run a program; exit status 2 after an error, 130 after Ctrl-C or SIGTERM.

    `run` is the function that hydra.main has made of the program's task; `resume` says what to do after an
    interruption. `-c job` prints the resolved configuration. An argument FILE.yaml is a resolved configuration, as
    scene.yaml of a sample, to begin with.
    """
    from hydra.errors import HydraException

    if "--version" in sys.argv[1:]:
        print(f"{program.name} {__version__}")  # Hydra would print its own
        return
    warn_plainly()
    multirun = [a for a in sys.argv[1:] if a in ("-m", "--multirun")]
    rest = quoted([a for a in sys.argv[1:] if a not in multirun])
    files = [a for a in rest if a.endswith((".yaml", ".yml")) and "=" not in a and Path(a).is_file()]
    rest = [a for a in rest if a not in files]
    overrides = [a for a in rest if "=" in a or a[:1] == "~"]
    sys.argv[1:] = multirun + rest  # Hydra does not look for it between overrides
    interrupt = Interrupt()
    try:
        with interrupt:
            program.check_deleted(overrides)
            program.check_plugins(overrides)
            program.register(with_help=bool({"-h", "--help"} & set(rest)))
            primary = program.register_file(Path(files[-1]), overrides) if files else ""
            if [a for a in rest if a not in overrides] in (["-c", "job"], ["--cfg", "job"]) and not multirun:
                _show(program, overrides, primary)
            else:
                sys.argv += ["--config-name", primary] if primary else []
                run()
    except (HydraException, ValueError) as error:
        if interrupt.seen:
            _interrupted(resume)
        complain(program.explain(error, overrides) if _of_hydra(error) else str(error))
        sys.exit(BAD)
    except KeyboardInterrupt:
        _interrupted(resume)
    except BrokenPipeError:  # the reader has seen enough, as in `--help | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except OSError as error:
        complain(_told(error))
        sys.exit(BAD)


def _interrupted(resume: str) -> NoReturn:
    print(f"interrupted: {resume}", file=sys.stderr)
    sys.exit(INTERRUPTED)


def _of_hydra(error: BaseException) -> bool:
    """Whether Hydra or OmegaConf raised an error; ours say what to do."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    raised_in = str(trace.tb_frame.f_globals.get("__name__")) if trace is not None else ""
    return raised_in.partition(".")[0] in ("hydra", "omegaconf")


def _show(program: Program[Any], overrides: Sequence[str], primary: str) -> None:
    """Print the resolved configuration as YAML; Hydra itself would show a draw instead of the drawn values.

    Raises ValueError when there is none.
    """
    from omegaconf import OmegaConf

    cfg = program.composed(overrides, primary=primary)
    print(OmegaConf.to_yaml(program.resolve(cfg, overrides)), end="")
