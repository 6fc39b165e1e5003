"""`python -m fracsim.lab.structure [SRC]`: how large functions are, how many arguments calls pass, what docstrings say.

A room is a folder of the package, or a module beside the folders. An arrow is an import from one room to another.
"""

import ast
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("fracsim", "fracgen")
SHAPE = re.compile(r"\((?:\.\.\.|[\w +]+),[^)]*\)|\[(?:\.\.\.|[\w +]+),[^\]]*\]|\[B\]|any shape|1-D")
"""A shape in a docstring, as (N, 3), (N,), (..., 3), [T, H, W] or [B]."""
LONG, MANY = 80, 8
"""Most lines of a function and most positional arguments of a call; launches of kernels may pass more."""
LAUNCHED = frozenset({"kernel", "_composite", "projector", "ParticleArrays"})
"""Names of variables that hold kernels, and of the list of arrays that a kernel makes of its arguments."""


@dataclass(frozen=True)
class Counts:
    """What one source tree looks like."""

    rooms: int
    arrows: int
    longest: tuple[int, str]
    """Lines and name of the longest function."""
    most_arguments: tuple[int, str]
    """Positional arguments and place of the largest call that launches no kernel."""
    array_functions: int
    """Public functions that take or return arrays."""
    without_shapes: tuple[str, ...]
    """Those whose docstring gives no shape."""


def modules(src: Path, package: str) -> Iterator[tuple[str, ast.Module]]:
    """Dotted name and syntax tree of each module."""
    for path in sorted((src / package).rglob("*.py")):
        name = ".".join(path.relative_to(src).with_suffix("").parts)
        yield name.removesuffix(".__init__"), ast.parse(path.read_text(encoding="utf-8"))


def room(module: str, src: Path) -> str:
    """The room of a module, or of a name in it."""
    package = src / module.partition(".")[0]
    path = package
    for k, part in enumerate(module.split(".")[1:], 1):
        if not (path / part).is_dir():
            return ".".join(module.split(".")[: max(k, 2) if path == package else k])
        path /= part
    return module


def imports(tree: ast.Module, package: str, known: frozenset[str]) -> Iterator[str]:
    """Modules of the package that a module imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith(package))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(package):
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else str(node.module)


def functions(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, ast.FunctionDef, bool]]:
    """Dotted name, node and whether it is public, of each function and method; nested ones are not public."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            name = f"{prefix}{node.name}"
            if isinstance(node, ast.FunctionDef):
                yield name, node, not isinstance(tree, ast.FunctionDef) and not node.name.startswith("_")
            yield from functions(node, f"{name}.")


def takes_arrays(node: ast.FunctionDef) -> bool:
    """Whether arrays are among the annotations of arguments and result; weights by name have shapes of their own."""
    annotations = [a.annotation for a in node.args.args] + [node.returns]
    texts = [re.sub(r"(?:dict|Mapping)\[str, Tensor\]", "", ast.unparse(a)) for a in annotations if a is not None]
    return any(re.search(r"\bArray\b|\bTensor\b|ndarray", text) for text in texts)


def is_kernel(node: ast.FunctionDef) -> bool:
    """Whether Taichi compiles a function as a kernel, whose signature gives the shapes."""
    return any(ast.unparse(d) == "ti.kernel" for d in node.decorator_list)


def calls(tree: ast.Module, kernels: frozenset[str]) -> Iterator[tuple[int, str]]:
    """Positional arguments and name of each call that launches no kernel."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            launches = isinstance(node.func, ast.Call) or called.rpartition(".")[2] in kernels
            if not launches and not any(isinstance(a, ast.Starred) for a in node.args):
                yield len(node.args), called


def count(src: Path, package: str) -> Counts:
    """Counts of a package in the folder `src`."""
    trees = dict(modules(src, package))
    known = frozenset(trees)
    rooms = {room(name, src) for name in trees} - {package}
    arrows = {(room(name, src), room(to, src)) for name, tree in trees.items() for to in imports(tree, package, known)}
    longest, most = (0, ""), (0, "")
    arrays: dict[str, bool] = {}
    kernels = LAUNCHED | {node.name for tree in trees.values() for _, node, _ in functions(tree) if is_kernel(node)}
    for name, tree in trees.items():
        most = max(most, *((n, f"{name}: {called}") for n, called in calls(tree, kernels)), (0, ""))
        for dotted, node, public in functions(tree):
            longest = max(longest, ((node.end_lineno or 0) - node.lineno + 1, f"{name}:{dotted}"))
            # Cases of a stress test take what they are given; they are no interface.
            if public and takes_arrays(node) and not is_kernel(node) and ".stress" not in name:
                arrays[f"{name}:{dotted}"] = bool(SHAPE.search(ast.get_docstring(node) or ""))
    between = {(a, b) for a, b in arrows if a != b and package not in (a, b)}
    without = tuple(name for name, shaped in arrays.items() if not shaped)
    return Counts(len(rooms), len(between), longest, most, len(arrays), without)


def main() -> None:
    """Print the counts of both packages of the tree in SRC, by default `src`."""
    for package in PACKAGES:
        c = count(Path(sys.argv[1] if len(sys.argv) > 1 else "src"), package)
        print(f"{package}: rooms {c.rooms}, arrows between them {c.arrows}")
        print(f"  longest function: {c.longest[0]} lines, {c.longest[1]}")
        print(f"  most positional arguments: {c.most_arguments[0]}, {c.most_arguments[1]}")
        given = c.array_functions - len(c.without_shapes)
        print(f"  array functions whose docstring gives a shape: {given} of {c.array_functions}")


if __name__ == "__main__":
    main()
