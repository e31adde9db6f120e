"""Perception modes by name: the shipped ones and those that other packages register."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points

import numpy as np

from simpick.envs.bin_pick import BinPickEnv
from simpick.errors import UnknownNameError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.oracle import OracleEstimator, PoseNoise
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.evaluation.run_config import RunConfig
from simpick.policies import Perception

ENTRY_POINT_GROUP = "simpick.estimators"
"""Where another package registers its estimator: a callable without arguments that returns a `PoseEstimator`."""

SHIPPED: dict[str, Callable[[], PoseEstimator]] = {}
"""Estimators that work from images alone and come with simpick."""


def estimator_names() -> list[str]:
    """Return every perception mode that can be asked for."""
    return ["oracle", *SHIPPED, *(e.name for e in entry_points(group=ENTRY_POINT_GROUP))]


def make_estimator(name: str) -> PoseEstimator:
    """Return a pose estimator that works from images alone.

    Raises:
        UnknownNameError: no estimator has this name; the message lists those that exist.
    """
    if name in SHIPPED:
        return SHIPPED[name]()
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            return entry.load()()
    raise UnknownNameError(
        "perception", name, estimator_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def make_perception(config: RunConfig, env: BinPickEnv, rng: np.random.Generator) -> Perception:
    """Return the perception that a configuration asks for; the oracle takes its truth from `env`."""
    detector_rng, noise_rng = rng.spawn(2)
    detector = SegmentationDetector(config.detections, detector_rng, instance_parts=env.instance_part_names)
    if config.perception == "oracle":
        noise = PoseNoise(config.noise_deg, config.noise_mm)
        return Perception("oracle", detector, OracleEstimator(env.truth, noise, noise_rng))
    return Perception(config.perception, detector, make_estimator(config.perception))
