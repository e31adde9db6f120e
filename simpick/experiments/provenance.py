"""What results depend on: settings, versions, the parts' shapes and grasps, weights."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from typing import Any

from simpick.assets import get_part, library_part_names
from simpick.caching import cache_key
from simpick.estimators.detections import SHIPPED, detector_data, is_simulated
from simpick.estimators.registry import ORACLE, find_estimator
from simpick.experiments.config import CellConfig, RunConfig
from simpick.experiments.perceptions import FOREGROUND_DETECTOR, FOREGROUND_FOR
from simpick.experiments.provenance_changes import GRASPS, MODE_DATA, PART_CONTENT, VERSIONS
from simpick.grasping.store import recipe, shipped_path

_PACKAGES = ("simpick", "mujoco", "torch")


def run_provenance(config: CellConfig, runs: Iterable[RunConfig]) -> dict[str, Any]:
    """Return what the results of `config`, which consists of these runs, depend on, for a `ResultStore`.

    Beside the settings these are versions, each mode's weights, the verified grasps, and the user's own parts, whose
    files may change under the same name.

    Raises:
        UnknownPartError, MeshError: a part does not exist or cannot be read.
        CheckpointError: a mode's weights are missing.
    """
    library = library_part_names()
    own = {name: get_part(name).content_hash for name in config.parts if name not in library}
    stored = [shipped_path(name, config.gripper) for name in config.parts or library if name not in own]
    grasps = cache_key(1, recipe(config.gripper), *(f.read_bytes() for f in stored if f.is_file()))
    provenance = config.to_json() | {
        VERSIONS: {name: version(name) for name in _PACKAGES},
        MODE_DATA: {run.mode: _mode_data(run) for run in runs},
        GRASPS: grasps,
    }
    return provenance | ({PART_CONTENT: own} if own else {})


def _mode_data(run: RunConfig) -> dict[str, str]:
    """Return what a mode's answers depend on: the files, or packages, of its estimator and of its detectors."""
    detections = run.detections_used
    data = detector_data(detections)
    # What another package detects may be boxes, which get masks from the shipped detector.
    if detections in FOREGROUND_FOR or not (is_simulated(detections) or detections in SHIPPED):
        data |= detector_data(FOREGROUND_DETECTOR)
    return data if run.estimator == ORACLE else find_estimator(run.estimator).data() | data
