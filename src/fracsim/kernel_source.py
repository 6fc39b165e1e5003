"""Less work for Taichi on the source of kernels, before it finds them among those that were compiled before.

A process reads the syntax tree of each kernel anew, though the compiled one lies on disk. For every node of it Taichi
(1.7.4) lays out the lines of source around the node, should an error occur there, and for every call of a function it
reads that function's source file again; and for every function that is defined it looks through all modules for the
source of the statement that defines it, to see whether that is a class. All three take longer than the rest. Here a
position is the file, the line and its text, a source is read once, and a class is known by its names. Sums over the
entries of a matrix, and products of two, are syntax trees of some hundred nodes in Taichi; here they are expressions.
"""

import sys
from collections.abc import Callable
from functools import cache, reduce
from typing import Any

import numpy as np

from fracsim.lanes import entry, held, inline


def quicken() -> None:
    """Make Taichi do so, from now on in this process; a Taichi without these parts is left as it is."""
    from taichi.lang import kernel_impl, matrix_ops
    from taichi.lang.ast import ast_transformer_utils

    context: Any = getattr(ast_transformer_utils, "ASTTransformerContext", None)
    if hasattr(context, "get_pos_info"):
        context.get_pos_info = position
    if hasattr(kernel_impl, "_inside_class"):
        kernel_impl._inside_class = inside_class
    for name in ("getsourcelines", "getsourcefile"):
        if hasattr(kernel_impl, name) and not hasattr(getattr(kernel_impl, name), "cache_info"):
            setattr(kernel_impl, name, cache(getattr(kernel_impl, name)))
    for name, expression in (("_reduce", reduced), ("_matmul_helper", product)):
        if hasattr(matrix_ops, name):
            setattr(matrix_ops, name, _in_kernels(expression, getattr(matrix_ops, name)))


def position(context: Any, node: Any) -> str:
    """Where a node of the tree of a Taichi function stands: its file, line, function, and the text of the line."""
    line = node.lineno + context.lineno_offset
    text = context.src[node.lineno - 1].rstrip()
    return f'File "{context.file}", line {line}, in {context.func.func.__name__}:\n{text}\n'


def inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the frame before that level, counted from here, is the body of a class."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


def _in_kernels(expression: Callable[..., Any], otherwise: Callable[..., Any]) -> Any:
    """A function of Taichi that is `expression` in kernels, and `otherwise` in Python."""
    from taichi.lang.expr import Expr

    @inline
    def either(*given: Any) -> Any:
        return (expression if isinstance(given[0], Expr) else otherwise)(*given)

    return either


def reduced(a: Any, function: Callable[[Any, Any], Any]) -> Any:
    """The entries of a vector or a matrix, combined one after the other."""
    a = held(a)
    return held(reduce(function, [entry(a, *index) for index in np.ndindex(*a.get_shape())]))


def product(a: Any, b: Any) -> Any:
    """A matrix times a matrix or a vector, or the product of two vectors."""
    from taichi.lang.matrix import make_matrix

    a, b = held(a), held(b)
    rows, columns = a.get_shape(), b.get_shape()

    def at(*index: int) -> Any:
        """Row i of a times column j of b."""
        i, j = index[: len(rows) - 1], index[len(rows) - 1 :]
        terms = [entry(a, *i, k) * entry(b, k, *j) for k in range(columns[0])]
        return reduce(lambda x, y: x + y, terms)

    if len(rows) == 1:
        return held(at())
    if len(columns) == 1:
        return held(make_matrix([at(i) for i in range(rows[0])]))
    return held(make_matrix([[at(i, j) for j in range(columns[1])] for i in range(rows[0])]))
