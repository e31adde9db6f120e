"""Rooms import one way only, and importing simpick stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

# A room may import rooms of its own layer or of earlier ones.
LAYERS = [
    {"errors", "records", "geometry", "caching", "config", "run_folder", "tensor_record", "workers"},
    {"assets"},
    {"scene", "rendering"},
    {"grasping", "motion", "bop", "estimators"},
    {"policies", "envs", "recording"},
    {"metrics"},
    {"pose_eval", "experiments", "training"},
    {"cli"},
]
LAYER_OF = {room: layer for layer, rooms in enumerate(LAYERS) for room in rooms}
FOLDERS = [ROOT / "simpick", ROOT / "assets", ROOT / "envs", ROOT / "estimators"]


def source_files() -> list[Path]:
    files = []
    for folder in FOLDERS:
        files += [f for f in folder.rglob("*.py") if not any(p.is_symlink() for p in f.parents)]
    return sorted(set(files))


def room_of(file: Path) -> str | None:
    parts = file.relative_to(ROOT).parts
    name = parts[1] if parts[0] == "simpick" else parts[0]
    return name.removesuffix(".py") if name != "__init__.py" or parts[0] != "simpick" else None


def imported_rooms(file: Path) -> set[str]:
    rooms = set()
    for node in ast.walk(ast.parse(file.read_text())):
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            modules = [node.module]
        rooms |= {m.split(".")[1] for m in modules if m.startswith("simpick.")}
    return rooms


@pytest.mark.parametrize("file", source_files(), ids=lambda f: str(f.relative_to(ROOT)))
def test_rooms_import_only_earlier_rooms(file: Path) -> None:
    room = room_of(file)
    if room is None:
        return
    too_late = {r for r in imported_rooms(file) if LAYER_OF[r] > LAYER_OF[room]}
    assert not too_late, f"{room} (layer {LAYER_OF[room]}) must not import {too_late}"


def test_every_room_has_a_layer() -> None:
    assert {room_of(f) for f in source_files()} - {None} <= LAYER_OF.keys()


def test_files_stay_under_400_lines() -> None:
    long = {str(f.relative_to(ROOT)): n for f in source_files() if (n := len(f.read_text().splitlines())) > 400}
    assert not long


def run_fresh(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize(
    "module", ["simpick", "simpick.records", "simpick.errors", "simpick.geometry", "simpick.cli.main"]
)
def test_importing_loads_no_heavy_library(module: str) -> None:
    heavy = "{'torch', 'mujoco', 'rerun', 'mink', 'trimesh', 'cv2', 'matplotlib'}"
    loaded = run_fresh(f"import sys, {module}; print(sorted({heavy} & sys.modules.keys()))").strip()
    assert loaded == "[]"


def test_importing_registers_the_environments() -> None:
    assert "True" in run_fresh("import simpick, gymnasium; print('simpick/BinPick-v0' in gymnasium.registry)")
