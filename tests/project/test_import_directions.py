"""Imports point one way, between rooms and between files, and importing simpick stays light."""

import re
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.project.source_imports import imported_modules, source_files

# A room is a folder or file of the package. It imports only rooms before it in this list.
ROOMS = (
    "errors",
    "json_text",
    "closing",
    "activity",
    "caching",
    "config",
    "folder_lock",
    "run_folder",
    "tensor_record",
    "threads",
    "core_time",
    "workers",
    "terminal",
    "plotting",
    "geometry",
    "records",
    "assets",
    "rendering",
    "scene",
    "bop",
    "grasping",
    "motion",
    "estimators",
    "envs",
    "policies",
    "recording",
    "photos",
    "metrics",
    "pose_eval",
    "experiments",
    "training",
    "cli",
)
MODULES = [module for module in source_files() if module != "simpick"]


def room_of(module: str) -> str:
    return module.split(".")[1]


@pytest.mark.parametrize("module", MODULES)
def test_a_room_imports_only_rooms_before_it(module: str) -> None:
    room = room_of(module)
    allowed = {"simpick", *(f"simpick.{earlier}" for earlier in ROOMS[: ROOMS.index(room) + 1])}
    wrong = {m for m in imported_modules(module) if ".".join(m.split(".")[:2]) not in allowed}
    assert not wrong, f"{module} must not import {sorted(wrong)}: {room} comes first in ROOMS"


def test_no_two_files_import_each_other() -> None:
    try:
        TopologicalSorter({module: imported_modules(module) for module in source_files()}).prepare()
    except CycleError as error:
        pytest.fail(f"files import each other: {' <- '.join(error.args[1])}")


def test_only_one_file_uses_rich() -> None:
    users = {
        module
        for module, file in source_files().items()
        if re.search(r"^\s*(from|import) rich\b", file.read_text(), re.M)
    }
    assert users == {"simpick.terminal"}


def test_every_room_is_in_the_list() -> None:
    assert {room_of(module) for module in MODULES} == set(ROOMS)


def test_files_stay_under_400_lines() -> None:
    lengths = {module: len(file.read_text().splitlines()) for module, file in source_files().items()}
    assert {module: length for module, length in lengths.items() if length > 400} == {}


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
