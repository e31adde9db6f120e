"""Run-time shape checks for the whole package, and a private cache, during tests only."""

import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import settings

from tests import runtime_types

# Before any simpick module is imported, so that every annotated function is checked.
runtime_types.install()

# The suite runs in one process per core; more threads would only wait for one another. Before torch is imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")

# A test must neither find nor leave anything in the user's cache. One folder for the whole run, so that what is
# expensive to make (verified grasps, templates) is made once, also across xdist's workers.
os.environ.setdefault("SIMPICK_CACHE", str(Path(tempfile.gettempdir()) / f"simpick-tests-{os.getuid()}"))

# The same examples in each run, so that a failure is of the change; `make fuzz` looks for new ones.
settings.register_profile("default", derandomize=True)
settings.register_profile("fuzz", max_examples=5000)
settings.load_profile("default")

SLOW = (
    "assets/test_library_parts.py",
    "assets/test_mesh_fuzz.py",
    "assets/test_mesh_repair.py",
    "assets/test_symmetry_detection.py",
    "bop/test_bop_fuzz.py",
    "cli/test_compare.py",
    "cli/test_run.py",
    "cli/test_soak.py",
    "cli/test_sweep.py",
    "cli/test_train.py",
    "envs/test_bin_pick.py",
    "envs/test_bin_pick_vector.py",
    "envs/test_bin_servo.py",
    "estimators/raypose/test_estimator.py",
    "estimators/refiner/test_refine",
    "examples/",
    "experiments/test_closer_look_refines.py",
    "grasping/test_sampling.py",
    "motion/test_executor.py",
    "motion/test_trajectory.py",
    "policies/",
    "photos/test_estimate.py",
    "photos/test_onboarding_f",
    "pose_eval/test_benchmark.py",
    "project/test_packaging.py",
    "project/test_public_api.py",
    "recording/test_rerun_recorder.py",
    "scene/test_settling.py",
    "test_file_fuzz.py",
    "test_workers.py",
    "training/data/test_shard",
    "training/detector/",
    "training/test_distributed.py",
    "training/test_trainer.py",
)
"""Files, or beginnings of paths, whose tests run episodes, processes or training; `make quick` leaves them out."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    folder = Path(__file__).parent
    for item in items:
        if item.path.relative_to(folder).as_posix().startswith(SLOW):
            item.add_marker(pytest.mark.slow)
