"""What the package imports is what pyproject.toml declares and what the constraints pin."""

import ast
import re
import sys
import tomllib
from pathlib import Path

from tests.project.source_imports import ROOT, source_files

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# Distributions whose name is not that of their module.
DISTRIBUTIONS = {"cv2": "opencv-python-headless", "rerun": "rerun-sdk", "yaml": "pyyaml"}
# Not imported by simpick: what trimesh needs for graphs and closest points.
INDIRECT = {"networkx", "rtree"}
# Only looked for: timm imports the first, and is made to work without it where it is broken; `simpick benchmark`
# measures the others beside simpick, in a process of their own.
NOT_NEEDED = {"torchvision", "gymnasium_robotics", "robosuite"}


def imported(file: Path) -> set[str]:
    """Return the top-level modules that a file imports, also in functions and by ``import_module("name")``."""
    modules = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            modules.add(str(node.module))
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            modules |= {argument.value for argument in node.args if isinstance(argument, ast.Constant)}
    return {str(module).partition(".")[0] for module in modules}


def distribution(text: str) -> str:
    """Return a distribution's name in the normal form, without its version."""
    return re.sub(r"[-_.]+", "-", re.split(r"[<>=!~\[; ]", text, maxsplit=1)[0]).lower()


def declared(*extras: str) -> set[str]:
    optional = PROJECT["optional-dependencies"]
    return {distribution(line) for lines in (PROJECT["dependencies"], *map(optional.get, extras)) for line in lines}


def used() -> set[str]:
    modules = set().union(*map(imported, source_files().values())) - sys.stdlib_module_names - NOT_NEEDED - {"simpick"}
    return {distribution(DISTRIBUTIONS.get(module, module)) for module in modules}


def test_every_imported_library_is_declared() -> None:
    assert used() - declared("cluster", "dinov2", "detector-training", "no-gl") == set()


def test_every_declared_library_is_imported() -> None:
    assert declared("cluster", "dinov2", "detector-training") - used() == INDIRECT


def test_every_declared_library_is_pinned() -> None:
    lines = (ROOT / ".ci/constraints.txt").read_text().splitlines()
    pinned = {distribution(line) for line in lines if line and not line.startswith("#")}
    assert declared("dev") - pinned == set()
