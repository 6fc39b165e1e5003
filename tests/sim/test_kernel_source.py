"""Taichi's messages still say where an error is, and an edited function is another one."""

import pytest
import taichi as ti

from fracsim import backend, kernel_source
from fracsim.scene.vocab import Backend


@ti.func
def wrong(x: float):
    return x + [1, 2].missing


@ti.kernel
def calls() -> float:
    return wrong(1.0)


def test_an_error_names_file_line_and_text() -> None:
    backend.start(Backend(threads=1))
    with pytest.raises(ti.TaichiCompilationError) as raised:
        calls()
    said = str(raised.value)
    assert f'File "{__file__}", line 12, in wrong' in said
    assert "return x + [1, 2].missing" in said
    assert f'File "{__file__}", line 17, in calls' in said


def test_a_position_is_one_line() -> None:
    class Node:
        lineno = 2

    class Context:
        file, lineno_offset, src = "law.py", 10, ["def stress(F):", "    return F  \n"]

        class func:  # noqa: N801
            def func() -> None:  # type: ignore[misc]
                """Stands for a law."""

    assert kernel_source.position(Context, Node) == 'File "law.py", line 12, in func:\n    return F\n'


def test_it_can_be_asked_for_twice() -> None:
    kernel_source.quicken()
    kernel_source.quicken()


def test_a_function_of_the_same_name_has_its_own_source() -> None:
    """As a law in a file that was edited in between: the source is that of the function, not of its name."""
    backend.start(Backend(threads=1))

    def made(factor: int):
        if factor == 2:

            @ti.kernel
            def scaled(x: float) -> float:
                return 2 * x
        else:

            @ti.kernel
            def scaled(x: float) -> float:
                return 3 * x

        return scaled

    assert (made(2)(1.5), made(3)(1.5)) == (3.0, 4.5)


def test_a_kernel_of_a_class_is_known_by_its_class() -> None:
    backend.start(Backend(threads=1))

    @ti.data_oriented
    class Doubler:
        def __init__(self) -> None:
            self.factor = 2.0

        @ti.kernel
        def of(self, x: float) -> float:
            return self.factor * x

    assert Doubler().of(3.0) == 6.0
