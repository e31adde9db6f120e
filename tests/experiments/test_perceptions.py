"""Perception by name."""

import numpy as np
import pytest

from simpick.envs.bin_pick import BinPickEnv
from simpick.errors import UnknownNameError
from simpick.experiments.perceptions import estimator_names, make_estimator, make_perception
from simpick.experiments.run_config import RunConfig


def test_episodes_share_a_shipped_estimator_but_not_its_detector() -> None:
    env = BinPickEnv(count=1)
    config = RunConfig(perception="retrieval", detections="realistic")
    first, second = (make_perception(config, env, np.random.default_rng(seed)) for seed in (0, 1))
    assert first.estimator is second.estimator
    assert first.detector is not second.detector


def test_oracles_are_not_shared_because_their_noise_is_an_episodes_own() -> None:
    env = BinPickEnv(count=1)
    first, second = (make_perception(RunConfig(), env, np.random.default_rng(seed)) for seed in (0, 1))
    assert first.estimator is not second.estimator


def test_an_unknown_name_lists_what_exists() -> None:
    assert {"oracle", "retrieval"} <= set(estimator_names())
    expected = r"no perception named 'telepathy'\. Valid: coarse, fine, oracle, refined, retrieval"
    with pytest.raises(UnknownNameError, match=expected):
        make_estimator("telepathy")
