"""Which files of the package import which, read from their source."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]


@cache
def source_files() -> dict[str, Path]:
    """Return each file of the package by the name of its module."""
    found = {}
    for folder in ("simpick", "assets", "envs", "estimators"):
        for file in sorted((ROOT / folder).rglob("*.py")):
            if not any(parent.is_symlink() for parent in file.parents):
                parts = file.relative_to(ROOT).with_suffix("").parts
                names = parts if parts[0] == "simpick" else ("simpick", *parts)
                found[".".join(names).removesuffix(".__init__")] = file
    return found


@cache
def imported_modules(module: str) -> frozenset[str]:
    """Return the modules of the package that a module imports, also in functions, but not for type checkers only.

    A public name that a package loads on first use counts as an import of the module that defines it.
    """
    found = set()
    for node in _run_time_nodes(ast.parse(source_files()[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            found |= {_home(node.module, alias.name) for alias in node.names}
    return frozenset(found & source_files().keys() - {module})


def _run_time_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            continue
        yield node
        yield from _run_time_nodes(node)


def _home(module: str, name: str) -> str:
    """Return the module that ``from module import name`` loads."""
    if f"{module}.{name}" in source_files():
        return f"{module}.{name}"
    stub = source_files()[module].with_suffix(".pyi") if module in source_files() else None
    if stub is not None and stub.exists():
        for node in ast.parse(stub.read_text()).body:
            if isinstance(node, ast.ImportFrom) and any(alias.name == name for alias in node.names):
                return _home(f"{module}.{node.module}", name)
    return module
