"""Compiled kernels: where they are kept, when they are made anew, and in which processes they run."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from fracsim import backend, caching
from tests.command import python

KERNEL = """
from fracsim import backend
import taichi as ti
from fracsim.scene.vocab import Backend
backend.start(Backend(threads={threads}))
@ti.kernel
def total(x: ti.types.ndarray(dtype=ti.f32, ndim=1)) -> ti.f32:
    s = 0.0
    for i in range(x.shape[0]):
        s += x[i]
    return s
x = ti.ndarray(ti.f32, 9)
x.fill(1)
print(total(x))
"""


@pytest.fixture(autouse=True)
def forgetful() -> Iterator[None]:
    """The folder of kernels is chosen once a process; here, for each test."""
    backend.kernels.cache_clear()
    yield
    backend.kernels.cache_clear()


def test_kernels_lie_in_the_folder_for_what_may_be_deleted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "mine"))
    assert backend.kernels() == tmp_path / "mine" / "kernels"


def test_a_folder_that_cannot_be_written_to_is_replaced_with_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("a file, where a folder is needed")
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path / "file"))
    monkeypatch.setattr(caching, "temporary", lambda: tmp_path / "other")
    with pytest.warns(UserWarning, match="file/kernels cannot be written to.*FRACSIM_CACHE"):
        assert backend.kernels() == tmp_path / "other" / "kernels"


def test_without_a_home_there_is_still_a_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    """HOME is unset, and the user has no entry in the list of users."""

    def lost() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("FRACSIM_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", lost)
    assert caching.folder().is_relative_to(caching.temporary())


def test_taichi_starts_without_a_home(monkeypatch: pytest.MonkeyPatch) -> None:
    """Alone it ends the process in C++."""
    monkeypatch.delenv("HOME", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert python("from fracsim import Backend, backend; backend.start(Backend()); print('started')") == "started\n"


def test_the_lock_of_a_killed_process_is_removed(tmp_path: Path) -> None:
    for name, age in (("ticache.lock", 2 * backend.STALE), ("metadata.lock", 0.0)):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (time.time() - age,) * 2)
    backend._unlock(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["metadata.lock"]


def kept_by(folder: Path, code: str) -> set[str]:
    """The files of kernels after a process has run KERNEL."""
    file = folder / "kernel.py"  # Taichi reads the source of a kernel
    file.write_text(code)
    assert python(f"exec(compile(open({str(file)!r}).read(), {str(file)!r}, 'exec'))") == "9.0\n"
    return {path.name for path in (folder / "kernels").glob("*.tic")}


def test_another_number_of_threads_finds_the_same_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine with one core runs one thread both times."""
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path))
    first, second = (kept_by(tmp_path, KERNEL.format(threads=threads)) for threads in (1, 2))
    assert first
    assert first == second


def test_a_program_that_collects_rarely_keeps_its_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its end frees no objects: the kernels are written by `backend.stop`, not by a destructor."""
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path))
    rarely = "from fracsim.entry.memory import collect_rarely\ncollect_rarely()\n"
    assert kept_by(tmp_path, rarely + KERNEL.format(threads=1))


def test_a_first_use_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FRACSIM_CACHE", str(tmp_path))
    monkeypatch.setattr(backend, "_started", None)
    assert backend.first_use()
    (tmp_path / "kernels" / "T0.tic").touch()
    assert not backend.first_use()


FORK = """
import os
from fracsim import Backend, Run, Scene, backend
backend.start(Backend(threads=1))
if os.fork() == 0:
    try:
        Run(Scene())
    except RuntimeError as error:
        print(error, flush=True)
    os._exit(0)
os.wait()
"""


def test_a_forked_worker_is_told_to_spawn() -> None:
    """It would wait for ever for threads that are not there."""
    said = python(FORK)
    assert said.startswith("this process was forked")
    assert 'get_context("spawn")' in said


@pytest.mark.parametrize(("threads", "cores", "expected"), [
    (2, {0, 1}, {21: {0}, 22: {1}}),
    (1, {0, 1}, {}),  # one thread may go where there is room
    (2, {0, 1, 4}, {}),  # two cores of three could share a unit that computes
])  # fmt: skip
def test_threads_get_a_core_each_if_there_are_as_many(
    threads: int, cores: set[int], expected: dict[int, set[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    given: dict[int, set[int]] = {}
    monkeypatch.setattr("os.sched_getaffinity", lambda _: cores, raising=False)
    monkeypatch.setattr("os.sched_setaffinity", lambda thread, to: given.update({thread: to}), raising=False)
    backend._spread({7, 21, 22}, threads)
    assert given == expected
