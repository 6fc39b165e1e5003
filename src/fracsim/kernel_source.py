"""Less work for Taichi on the source of kernels, before it finds them among those that were compiled before.

A process reads the syntax tree of each kernel anew, though the compiled one lies on disk. For every node of it Taichi
(1.7.4) lays out the lines of source around the node, should an error occur there, and for every call of a function it
reads that function's source file again; and for every function that is defined it looks through all modules for the
source of the statement that defines it, to see whether that is a class. All three take longer than the rest. Here a
position is the file, the line and its text, a source is read once, and a class is known by its names.
"""

import sys
from functools import cache
from typing import Any


def quicken() -> None:
    """Make Taichi do so, from now on in this process; a Taichi without these parts is left as it is."""
    from taichi.lang import kernel_impl
    from taichi.lang.ast import ast_transformer_utils

    context: Any = getattr(ast_transformer_utils, "ASTTransformerContext", None)
    if hasattr(context, "get_pos_info"):
        context.get_pos_info = position
    if hasattr(kernel_impl, "_inside_class"):
        kernel_impl._inside_class = inside_class
    for name in ("getsourcelines", "getsourcefile"):
        if hasattr(kernel_impl, name) and not hasattr(getattr(kernel_impl, name), "cache_info"):
            setattr(kernel_impl, name, cache(getattr(kernel_impl, name)))


def position(context: Any, node: Any) -> str:
    """Where a node of the tree of a Taichi function stands: its file, line, function, and the text of the line."""
    line = node.lineno + context.lineno_offset
    text = context.src[node.lineno - 1].rstrip()
    return f'File "{context.file}", line {line}, in {context.func.func.__name__}:\n{text}\n'


def inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the frame before that level, counted from here, is the body of a class."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals
