"""Perception by name."""

import numpy as np
import pytest

from simpick.envs.bin_pick import BinPickEnv
from simpick.experiments.config import RunConfig
from simpick.experiments.perceptions import make_perception
from simpick.experiments.provenance import run_provenance


def test_episodes_share_a_shipped_estimator_but_not_its_detector() -> None:
    env = BinPickEnv(count=1)
    config = RunConfig(estimator="retrieval", detections="realistic")
    first, second = (make_perception(config, env, np.random.default_rng(seed)) for seed in (0, 1))
    assert first.estimator is second.estimator
    assert first.detector is not second.detector


def test_oracles_are_not_shared_because_their_noise_is_an_episodes_own() -> None:
    env = BinPickEnv(count=1)
    first, second = (
        make_perception(RunConfig(estimator="oracle"), env, np.random.default_rng(seed)) for seed in (0, 1)
    )
    assert first.estimator is not second.estimator


@pytest.mark.parametrize(
    ("estimator", "detections", "found"),
    [
        ("oracle", "perfect", False),
        ("oracle", "realistic", True),
        ("oracle", "learned", False),
        ("retrieval", "box", True),
        ("retrieval", "perfect", False),
    ],
)
def test_the_foreground_is_found_for_detections_that_miss_parts(estimator: str, detections: str, found: bool) -> None:
    config = RunConfig(estimator=estimator, detections=detections)
    perception = make_perception(config, BinPickEnv(count=1), np.random.default_rng(0))
    assert (perception.foreground is not None) == found
    weights = [name for name in run_provenance(config, [config])["mode_data"][estimator] if "detector" in name]
    assert bool(weights) == found


def test_the_learned_detector_reports_its_own_foreground() -> None:
    config = RunConfig(estimator="retrieval", detections="learned")
    assert make_perception(config, BinPickEnv(count=1), np.random.default_rng(0)).foreground is None
