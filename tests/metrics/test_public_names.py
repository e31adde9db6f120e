"""The package's public names exist, load late, and are the ones that type checkers see."""

import ast
import subprocess
import sys
from pathlib import Path

import simpick.metrics as metrics


def test_every_name_loads_from_where_type_checkers_see_it() -> None:
    tree = ast.parse(Path(metrics.__file__).read_text())
    seen = {
        alias.asname: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("simpick.")
        for alias in node.names
    }
    assert seen == {name: f"simpick.metrics.{module}" for name, module in metrics._MODULE_OF.items()}
    for name in seen:
        assert callable(getattr(metrics, str(name)))


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(metrics, "no_such_score")


def test_importing_the_package_loads_no_heavy_library() -> None:
    code = "import sys, simpick.metrics; print({'scipy', 'trimesh', 'torch', 'mujoco'} & sys.modules.keys())"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
