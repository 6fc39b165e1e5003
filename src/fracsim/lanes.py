"""Numbers of several particles side by side, which a CPU computes by one instruction: vectors of WIDTH, and 3 x 3
matrices of such vectors.

A law is written once, for one particle. Given lanes it computes WIDTH particles: `F[0, 1]` is then a vector, `F @ G`
and `2 * mu * F` are matrices of vectors. Three things differ. A condition that is not the same in all lanes is
`ti.select(...)`, or `some(...)` where the work may be left out if no lane needs it. A matrix is made by `matrix(rows)`.
And functions that no instruction computes, as `ti.log`, are computed lane by lane.

Taichi (1.7.4) keeps a vector in one register only in kernels compiled with `real_matrix_scalarize` off, which `Vectors`
turns off: `python -m fracsim.bench substep` shows what that gains.
"""

import operator
from collections.abc import Callable, Sequence
from typing import Any

import taichi as ti
from taichi.lang import common_ops, impl, matrix_ops, ops
from taichi.lang.expr import Expr
from taichi.lang.matrix import make_matrix

WIDTH = 8
"""Lanes: a register of AVX holds eight numbers of float32."""
AUGMENTED = {"Add": operator.add, "Sub": operator.sub, "Mult": operator.mul, "Div": operator.truediv}
"""What `a += b` and its like do; Taichi takes them for atomic operations, which vectors do not have."""
LANEWISE = ("acos", "asin", "cos", "exp", "log", "rsqrt", "sin", "tan", "tanh")
"""Functions of one number that Taichi does not compile for vectors."""


def inline(function: Callable[..., Any]) -> Any:
    """Let kernels call a Python function while Taichi compiles them."""
    function._is_taichi_function = True  # type: ignore[attr-defined]
    function.func = function  # type: ignore[attr-defined]
    function.has_print = False  # type: ignore[attr-defined]
    return function


def is_lanes(value: Any) -> bool:
    """Whether a number in a kernel is a vector of lanes; in kernels without lanes a vector of WIDTH is none."""
    return Vectors.compiling and isinstance(value, Expr) and value.is_tensor() and tuple(value.get_shape()) == (WIDTH,)


def held(value: Any) -> Any:
    """A value, or a list of them, computed once: each use of a Python name in a kernel computes it anew otherwise."""
    return impl.expr_init(value)


def entry(array: Any, *index: Any) -> Any:
    """An entry of an array, a vector or a matrix in a kernel, to read it or to assign to it."""
    return array[index] if isinstance(array, Matrix3) else impl.subscript(None, array, *index)


@inline
def vector(values: Sequence[Any]) -> Any:
    """A vector of lanes from WIDTH numbers."""
    return impl.expr_init(make_matrix(list(values)))


@inline
def matrix(rows: Sequence[Sequence[Any]]) -> Any:
    """The 3 x 3 matrix of these numbers, or of these vectors of lanes."""
    if any(is_lanes(entry) for row in rows for entry in row):
        return Matrix3(rows)
    return make_matrix([list(row) for row in rows])


@inline
def some(condition: Any) -> Any:
    """Whether a condition holds, or holds in any lane."""
    if is_lanes(condition):
        return matrix_ops.max(impl.expr_init(ops.select(condition, 1, 0))) > 0
    return condition


@inline
def total(value: Any) -> Any:
    """A number, or the sum over its lanes."""
    return matrix_ops.sum(impl.expr_init(value)) if is_lanes(value) else value


class Matrix3:
    """A 3 x 3 matrix whose entries are vectors of lanes; has what laws use of Taichi's matrices."""

    _data_oriented = True

    def __init__(self, rows: Sequence[Sequence[Any]]) -> None:
        self.rows = [[impl.expr_init(entry) for entry in row] for row in rows]

    def __getitem__(self, at: tuple[int, int]) -> Any:
        return self.rows[at[0]][at[1]]

    def _assign(self, other: "Matrix3") -> None:
        for row, values in zip(self.rows, other.rows, strict=True):
            for entry, value in zip(row, values, strict=True):
                entry._assign(value)

    def _augassign(self, other: Any, op: str) -> None:
        self._assign(AUGMENTED[op](self, other))

    def _each(self, other: Any, op: Callable[[Any, Any], Any]) -> "Matrix3":
        right = other.rows if isinstance(other, Matrix3) else [[other] * 3] * 3
        return Matrix3([[op(self.rows[i][j], right[i][j]) for j in range(3)] for i in range(3)])

    def __add__(self, other: Any) -> "Matrix3":
        return self._each(other, lambda a, b: a + b)

    def __sub__(self, other: Any) -> "Matrix3":
        return self._each(other, lambda a, b: a - b)

    def __mul__(self, other: Any) -> "Matrix3":
        return self._each(other, lambda a, b: a * b)

    def __truediv__(self, other: Any) -> "Matrix3":
        return self._each(other, lambda a, b: a / b)

    def __neg__(self) -> "Matrix3":
        return self._each(-1, lambda a, b: a * b)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: Any) -> "Matrix3":
        return self._each(other, lambda a, b: b - a)

    def __matmul__(self, other: "Matrix3") -> "Matrix3":
        a, b = self.rows, other.rows
        return Matrix3([[a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j] for j in range(3)]
                        for i in range(3)])  # fmt: skip

    @inline
    def transpose(self) -> "Matrix3":
        """A^T; shares its entries."""
        out = Matrix3.__new__(Matrix3)
        out.rows = [[self.rows[j][i] for j in range(3)] for i in range(3)]
        return out

    @inline
    def sum(self) -> Any:
        """The sum of the entries."""
        a = [entry for row in self.rows for entry in row]
        return impl.expr_init(((a[0] + a[1] + a[2]) + (a[3] + a[4] + a[5])) + (a[6] + a[7] + a[8]))

    @inline
    def norm_sqr(self) -> Any:
        """|A|^2."""
        return (self * self).sum()

    @inline
    def norm(self) -> Any:
        """|A|."""
        return ops.sqrt(self.norm_sqr())

    @inline
    def trace(self) -> Any:
        """tr A."""
        return impl.expr_init(self[0, 0] + self[1, 1] + self[2, 2])

    @inline
    def determinant(self) -> Any:
        """det A."""
        a = self
        return impl.expr_init(
            a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1])
            - a[1, 0] * (a[0, 1] * a[2, 2] - a[0, 2] * a[2, 1])
            + a[2, 0] * (a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1])
        )


class Vectors:
    """`with Vectors():` kernels that are called for the first time are compiled with lanes in registers."""

    compiling = False

    def __enter__(self) -> None:
        _extend()
        Vectors.compiling, _config().real_matrix_scalarize = True, False

    def __exit__(self, *_: object) -> None:
        Vectors.compiling, _config().real_matrix_scalarize = False, True


def _config() -> Any:
    return impl.get_runtime().prog.config()


def _extend() -> None:
    """Make Taichi's operators leave matrices of lanes to `Matrix3`, and compute LANEWISE functions lane by lane."""
    if hasattr(ops, "_without_lanes"):
        return
    ops._without_lanes = ops._unary_operation, ops._binary_operation
    for name in ("__add__", "__sub__", "__mul__"):
        setattr(common_ops.TaichiOperations, name, _yielding(getattr(common_ops.TaichiOperations, name)))
    augment = common_ops.TaichiOperations._augassign

    def augmented(self: Any, value: Any, op: str) -> Any:
        return self._assign(AUGMENTED[op](self, value)) if is_lanes(self) else augment(self, value, op)

    common_ops.TaichiOperations._augassign = augmented
    unary, binary = ops._without_lanes
    product = matrix_ops.matmul
    matrix_ops.matmul = lambda a, b: a @ b if isinstance(a, Matrix3) else product(a, b)
    core = ti._lib.core
    lanewise = {id(getattr(core, f"expr_{name}", None)) for name in LANEWISE}

    def of_one(taichi_op: Any, python_op: Any, a: Any) -> Any:
        if is_lanes(a):
            if taichi_op is core.expr_neg:
                return a * -1
            if taichi_op is core.expr_abs:
                return ops.max(a, a * -1)
            if id(taichi_op) in lanewise:
                x = impl.expr_init(a)
                return make_matrix([unary(taichi_op, python_op, _lane(x, k)) for k in range(WIDTH)])
        return unary(taichi_op, python_op, a)

    def of_two(taichi_op: Any, python_op: Any, a: Any, b: Any) -> Any:
        if (is_lanes(a) or is_lanes(b)) and taichi_op in (core.expr_pow, core.expr_atan2):
            if taichi_op is core.expr_pow and isinstance(b, int):
                return binary(taichi_op, python_op, a, b)
            x, y = (impl.expr_init(v) if is_lanes(v) else v for v in (a, b))
            return make_matrix([binary(taichi_op, python_op, _lane(x, k), _lane(y, k)) for k in range(WIDTH)])
        return binary(taichi_op, python_op, a, b)

    ops._unary_operation, ops._binary_operation = of_one, of_two


def _lane(value: Any, k: int) -> Any:
    return impl.subscript(None, value, k) if is_lanes(value) else value


def _yielding(op: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """The operator, which leaves the work to a `Matrix3` on its right."""

    def either(self: Any, other: Any) -> Any:
        return NotImplemented if isinstance(other, Matrix3) else op(self, other)

    return either
