"""Perception modes by name: the shipped ones and those that other packages register."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.metadata import entry_points

import numpy as np

from simpick.envs.bin_pick import BinPickEnv
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.oracle import OracleEstimator, PoseNoise
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.evaluation.run_config import RunConfig
from simpick.policies import Perception

ENTRY_POINT_GROUP = "simpick.estimators"
"""Where another package registers its estimator: a callable without arguments that returns a `PoseEstimator`."""


def _retrieval(hypotheses: int | None) -> PoseEstimator:
    # Only here, because it loads torch.
    from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator

    return RetrievalEstimator(None if hypotheses is None else RetrievalConfig(hypotheses=hypotheses))


SHIPPED: dict[str, Callable[[int | None], PoseEstimator]] = {"retrieval": _retrieval}
"""Estimators that work from images alone and come with simpick; made for this many hypotheses, or their own number."""


def estimator_names() -> list[str]:
    """Return every perception mode that can be asked for."""
    return ["oracle", *SHIPPED, *(e.name for e in entry_points(group=ENTRY_POINT_GROUP))]


def make_estimator(name: str, hypotheses: int | None = None) -> PoseEstimator:
    """Return a pose estimator that works from images alone, asked for this many hypotheses or for its own number.

    Raises:
        UnknownNameError: no estimator has this name; the message lists those that exist.
        ConfigError: a number of hypotheses that the estimator does not take.
    """
    if name in SHIPPED:
        return SHIPPED[name](hypotheses)
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            if hypotheses is not None:
                raise ConfigError(
                    f"{name!r} comes from another package and decides itself how many hypotheses it makes"
                )
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
    make = _shared_estimator if config.perception in SHIPPED else make_estimator
    estimator = make(config.perception, config.hypotheses)
    return Perception(config.perception, detector, estimator)


@cache
def _shared_estimator(name: str, hypotheses: int | None) -> PoseEstimator:
    """Return this process's one estimator of that name, so that parts are onboarded once and not once an episode.

    All that were asked for are kept, because a comparison asks for each of its modes in turn, bin after bin.

    Only for shipped ones, which keep nothing between images but their onboarded parts: another package's may keep
    more, and an episode's results must not hang on the episodes before it.
    """
    return make_estimator(name, hypotheses)
