"""The public names: each loads, late, and is one that type checkers see."""

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import simpick
from simpick import BinPickEnv, Perception, PickPolicy, compare, get_part, run_episode
from simpick.estimators import OracleEstimator, SegmentationDetector
from simpick.experiments import CompareConfig

ROOT = Path(__file__).parents[2]
STUBS = sorted(
    file
    for folder in ("simpick", "assets", "envs", "estimators")
    for file in (ROOT / folder).rglob("__init__.pyi")
    if not any(parent.is_symlink() for parent in file.parents)
)


def package_of(stub: Path) -> str:
    parts = stub.parent.relative_to(ROOT).parts
    return ".".join(parts if parts[0] == "simpick" else ("simpick", *parts))


@pytest.mark.parametrize("stub", STUBS, ids=package_of)
def test_every_public_name_loads_and_is_in_the_stub(stub: Path) -> None:
    package = importlib.import_module(package_of(stub))
    tree = ast.parse(stub.read_text())
    listed = {alias.asname for node in tree.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert listed == set(package.__all__) <= set(dir(package))
    for name in package.__all__:
        getattr(package, name)
    with pytest.raises(AttributeError):
        package.no_such_name  # noqa: B018 - the attribute access is the test


def test_no_package_imports_its_public_names_early() -> None:
    for stub in STUBS:
        tree = ast.parse(stub.with_suffix(".py").read_text())
        early = {node.module for node in tree.body if isinstance(node, ast.ImportFrom)}
        # Registration costs no library beyond gymnasium; the OpenGL back end is checked before MuJoCo is imported.
        assert early <= {"gymnasium.envs.registration", "simpick.rendering.gl"}, stub


def test_the_docstring_lists_the_public_names() -> None:
    assert simpick.__doc__ is not None
    assert set(re.findall(r"^`(\w+)` ", simpick.__doc__, re.MULTILINE)) == set(vars(simpick)["__all__"])


def test_the_readme_imports_at_most_two_names_deep() -> None:
    imports = re.findall(r"^(?:from|import) (simpick\S*)", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert "simpick" in imports
    assert [name for name in imports if name.count(".") > 1] == []


@pytest.mark.parametrize(
    "package",
    ["simpick", *(f"simpick.{name}" for name in ("assets", "experiments", "geometry", "metrics", "training"))],
)
def test_importing_a_package_loads_no_heavy_library(package: str) -> None:
    heavy = {"torch", "mujoco", "rerun", "trimesh", "scipy", "cv2", "mink", "matplotlib", "rich", "tyro"}
    code = f"import sys, {package}; print(sorted({heavy} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_a_comparison_picks_as_the_same_policy_put_together_by_hand(tmp_path: Path) -> None:
    config = CompareConfig(modes=("oracle",), parts=("pipe_tee",), count=1, episodes=1, seed=3)
    compared = compare(config, tmp_path).results
    env = BinPickEnv(parts=["pipe_tee"], count=1)
    detector = SegmentationDetector(instance_parts=env.instance_part_names)
    policy = PickPolicy(Perception("oracle", detector, OracleEstimator(env.truth)), env.parts, env.scene_config)
    picks = []
    result = run_episode(env, policy, seed=3, on_pick=picks.append)
    env.close()
    assert result.instances == (get_part("pipe_tee").name,) and result.ended == "cleared"
    assert tuple(picks) == result.picks
    assert [line.to_json(timings=False) for line in compared] == [result.to_json(timings=False)]
