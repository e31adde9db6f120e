"""Perception by name."""

import numpy as np

from simpick.envs.bin_pick import BinPickEnv
from simpick.experiments.config import RunConfig
from simpick.experiments.perceptions import make_perception


def test_episodes_share_a_shipped_estimator_but_not_its_detector() -> None:
    env = BinPickEnv(count=1)
    config = RunConfig(estimator="retrieval", detections="realistic")
    first, second = (make_perception(config, env, np.random.default_rng(seed)) for seed in (0, 1))
    assert first.estimator is second.estimator
    assert first.detector is not second.detector


def test_oracles_are_not_shared_because_their_noise_is_an_episodes_own() -> None:
    env = BinPickEnv(count=1)
    first, second = (make_perception(RunConfig(), env, np.random.default_rng(seed)) for seed in (0, 1))
    assert first.estimator is not second.estimator
