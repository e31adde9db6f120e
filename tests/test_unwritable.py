"""Disks that are full or read-only: pictures and exports say what happened and leave nothing half-written."""

from __future__ import annotations

import ast
import errno
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from simpick.assets import get_part
from simpick.bop.detections_json import write_detections
from simpick.bop.images import write_color, write_depth, write_mask
from simpick.bop.results_csv import write_results
from simpick.caching import write_arrays
from simpick.cli.outputs import write_image
from simpick.errors import OutputError
from simpick.estimators.detector.checkpoints import save_detector_checkpoint
from simpick.estimators.detector.network import InstanceNetwork
from simpick.estimators.detector.scores import MaskScore
from simpick.estimators.raypose.checkpoints import save_checkpoint
from simpick.grasping.store import save_grasps
from simpick.photos.onboarding_file import save_onboarding
from simpick.photos.outputs import PoseFiles
from simpick.plotting import new_figure, save_figure
from tests.estimators.raypose.networks import awake
from tests.project.source_imports import source_files

RGB = np.zeros((4, 5, 3), np.uint8)
WRITERS: dict[str, Callable[[Path], object]] = {
    "picture.png": lambda file: write_image(file, RGB),
    "plot.png": lambda file: save_figure(new_figure(1, 1), file),
    "color.jpg": lambda file: write_color(file, RGB),
    "depth.png": lambda file: write_depth(file, np.ones((4, 5)), 0.1),
    "mask.png": lambda file: write_mask(file, np.zeros((4, 5), bool)),
    "results.csv": lambda file: write_results(file, []),
    "detections.json": lambda file: write_detections(file, [], lambda part: 1),
    "poses.json": lambda file: PoseFiles((), "fine", probabilities=False).write(file.parent),
    "arrays.npz": lambda file: write_arrays(file, {"rgb": RGB}),
    "grasps.npz": lambda file: save_grasps(file, get_part("hex_nut"), "jaw", []),
    "nut.simpick": lambda file: save_onboarding(file, get_part("hex_nut"), []),
    "raypose.safetensors": lambda file: save_checkpoint(file, awake(), {}),
    "detector.safetensors": lambda file: save_detector_checkpoint(file, InstanceNetwork(), MaskScore(0.0, (1.0,)), {}),
}


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS])
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_cannot_be_written_is_reported_and_what_was_there_is_kept(
    name: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / name
    file.write_bytes(b"before")

    def refuse(self: Path, target: Path) -> Path:
        raise OSError(code, os.strerror(code), str(target))

    # The last step, when a whole temporary file lies beside.
    monkeypatch.setattr(Path, "replace", refuse)
    with pytest.raises(OutputError, match=rf"{name}.*{os.strerror(code)}") as raised:
        WRITERS[name](file)
    assert "kept" in str(raised.value)
    assert [f.name for f in tmp_path.iterdir() if f.name != ".lock"] == [name] and file.read_bytes() == b"before"


WRITING = {
    "write_text",
    "write_bytes",
    "savez",
    "savez_compressed",
    "imwrite",
    "savefig",
    "tofile",
    "to_csv",
    "savetxt",
}
OWN_ERRORS = {
    "simpick.caching": "the door itself",
    "simpick.experiments.report.plots": "into memory",
    "simpick.plotting": "into the temporary file of `atomic_path`",
    "simpick.run_folder": "`RunFolder` explains its own",
    "simpick.folder_lock": "explained by `RunFolder`",
    "simpick.recording.recording_file": "rerun writes recordings itself",
    "simpick.assets.user_parts": "a folder is put in place at once",
    "simpick.training.detector.bin_files": "into memory",
}
"""Files that write without the functions of `simpick.caching`, and why."""


def test_all_else_is_written_through_one_door() -> None:
    found = set()
    for module, path in source_files().items():
        calls = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call))
        names = {call.func.attr for call in calls if isinstance(call.func, ast.Attribute)}
        if names & WRITING:
            found.add(module)
    assert found == OWN_ERRORS.keys()
