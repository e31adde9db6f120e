"""The perception that a run asks for: a detector and an estimator, the oracle's truth taken from an environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial

import numpy as np

from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.estimators.base import ForegroundDetector, PoseEstimator, PoseRefiner
from simpick.estimators.detections import make_detector
from simpick.estimators.oracle import OracleEstimator, OracleRefiner, PoseNoise
from simpick.estimators.registry import ORACLE, SHIPPED, load_estimator
from simpick.experiments.config import RunConfig
from simpick.policies import Perception
from simpick.records import InstanceTruth

FOREGROUND_DETECTOR = "learned"
FOREGROUND_FOR = ("realistic", "box")
"""Detections that miss parts and know nothing of the foreground: the detector above finds it in the image for them."""


def make_perception(config: RunConfig, env: BinPickEnv, rng: np.random.Generator) -> Perception:
    """Return the perception that a configuration asks for; the oracle takes its truth from `env`."""
    return _perception(config, env.instance_part_names, env.truth, rng)


def make_vector_perceptions(
    config: RunConfig, envs: BinPickVectorEnv, rngs: Sequence[np.random.Generator]
) -> list[Perception]:
    """Return a perception for each environment, what is random in it from its own `rngs`.

    Shipped estimators that work from images alone are one and the same in all of them, so that they answer in a batch.
    """
    return [
        _perception(config, partial(envs.instance_part_names, k), partial(envs.truth, k), rng)
        for k, rng in enumerate(rngs)
    ]


def _perception(
    config: RunConfig,
    instance_parts: Callable[[], Sequence[str]],
    truth: Callable[[], Sequence[InstanceTruth]],
    rng: np.random.Generator,
) -> Perception:
    detector_rng, noise_rng = rng.spawn(2)
    detector = make_detector(config.detections_used, instance_parts, detector_rng)
    if config.estimator == ORACLE:
        noise = PoseNoise(config.noise_deg, config.noise_mm)
        estimator = OracleEstimator(truth, noise, noise_rng)
    else:
        make = _shared_estimator if config.estimator in SHIPPED else load_estimator
        estimator = make(config.estimator, hypotheses=config.hypotheses)
    foreground = None
    if config.detections_used in FOREGROUND_FOR:
        foreground = make_detector(FOREGROUND_DETECTOR, instance_parts, detector_rng)
        assert isinstance(foreground, ForegroundDetector)
    return Perception(config.estimator, detector, estimator, foreground)


def make_refiner(config: RunConfig, env: BinPickEnv) -> PoseRefiner:
    """Return what corrects poses by the wrist camera's image: the truth for the oracle, else the refiner."""
    return OracleRefiner(env.truth) if config.estimator == ORACLE else _shared_refiner()


@cache
def _shared_refiner() -> PoseRefiner:
    from simpick.estimators.refiner import Refiner

    return Refiner()


@cache
def _shared_estimator(name: str, hypotheses: int | None) -> PoseEstimator:
    """Return the one estimator of that name in this process, so that parts are onboarded once, not per episode.

    All estimators are kept, because a comparison uses each of its modes in turn, bin after bin.

    Only for those that ship, which keep nothing between images but their onboarded parts: another package's estimator
    may keep more, and the results of an episode must not depend on the episodes before it.
    """
    return load_estimator(name, hypotheses=hypotheses)
