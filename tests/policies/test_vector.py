"""Perception and picking for several bins at once equal those for one."""

import numpy as np
import pytest
from gymnasium import spaces

from simpick.cli.main import main
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_pick_vector import BinPickVectorEnv
from simpick.envs.observations import frame_from_observation
from simpick.errors import ConfigError
from simpick.estimators.base import BatchPoseEstimator
from simpick.estimators.boundary import validated_estimates
from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.experiments.config import RunConfig
from simpick.experiments.perceptions import make_perception, make_vector_perceptions
from simpick.policies import (
    Perception,
    PickPolicy,
    PoseObservation,
    PoseVectorObservation,
    VectorPickPolicy,
    perceive_together,
)
from simpick.policies.vector import row
from simpick.records import PoseEstimate
from tests.small_scenes import small_scene

SCENE = small_scene("hex_bolt", "pipe_tee", count=3, width_px=320, height_px=240)
TRUE_POSES = RunConfig(estimator="oracle")
BLURRED = RunConfig(estimator="oracle", noise_mm=1.0, noise_deg=2.0, detections="realistic")


def rngs() -> list[np.random.Generator]:
    return [np.random.default_rng([seed, 1]) for seed in (5, 6)]


@pytest.fixture(scope="module")
def envs():
    with_workers = BinPickVectorEnv(2, scene_config=SCENE)
    yield with_workers
    with_workers.close()


class Counting:
    """An estimator without batches that notes how often it is asked."""

    def __init__(self) -> None:
        self.frames = []

    def onboard(self, part) -> None:
        pass

    def estimate(self, frame, detections) -> list[PoseEstimate]:
        self.frames.append(frame)
        return [PoseEstimate(d.part, np.eye(4), 1.0, "counting", 0.0, detection=d) for d in detections]


@pytest.mark.render
def test_the_vector_policy_picks_what_single_policies_pick(envs) -> None:
    policy = VectorPickPolicy(make_vector_perceptions(BLURRED, envs, rngs()), envs.parts, SCENE)
    observations, _ = envs.reset(seed=5)
    together, ended = [], np.zeros(2, bool)
    for _ in range(3):
        actions = policy.act(observations, ended)
        together.append((actions, ended))
        observations, _, ended, _, _ = envs.step(actions)
    for k in range(2):
        env = BinPickEnv(scene_config=SCENE)
        single = PickPolicy(make_perception(BLURRED, env, rngs()[k]), env.parts, SCENE)
        observation, _ = env.reset(seed=5 + k)
        for actions, was_ended in together:
            if was_ended[k]:
                break
            action = single.act(observation)
            assert action.any()
            np.testing.assert_array_equal(action, actions[k])
            observation, *_ = env.step(action)
        env.close()


@pytest.mark.render
def test_the_wrapper_observes_what_single_wrappers_observe(envs) -> None:
    wrapped = PoseVectorObservation(envs, make_vector_perceptions(BLURRED, envs, rngs()))
    observations, _ = wrapped.reset(seed=5)
    assert observations in wrapped.observation_space
    assert isinstance(wrapped.single_observation_space, spaces.Dict)
    assert wrapped.single_observation_space["estimated_poses"].shape == (50, 4, 4)
    env = BinPickEnv(scene_config=SCENE)
    single = PoseObservation(env, make_perception(BLURRED, env, rngs()[1]))
    alone, _ = single.reset(seed=6)
    assert alone.keys() == observations.keys() and (alone["estimated_parts"] >= 0).any()
    for key, value in alone.items():
        np.testing.assert_array_equal(observations[key][1], value)
    env.close()


@pytest.mark.render
def test_an_ended_environment_is_not_looked_at(envs) -> None:
    estimator = Counting()
    perceptions = [Perception("counting", SegmentationDetector(instance_parts=["hex_bolt"] * 3), estimator)] * 2
    policy = VectorPickPolicy(perceptions, envs.parts, SCENE)
    observations, _ = envs.reset(seed=5)
    actions = policy.act(observations, np.array([True, False]))
    assert not actions[0].any() and len(estimator.frames) == 1
    with pytest.raises(ConfigError, match="one perception for each of the 1 environments, got 2"):
        policy.act({key: values[:1] for key, values in observations.items()})


@pytest.mark.render
def test_retrieval_answers_several_frames_as_it_answers_each(envs) -> None:
    observations, _ = envs.reset(seed=5)
    estimator = RetrievalEstimator(RetrievalConfig(views=42, turns=24))
    assert isinstance(estimator, BatchPoseEstimator)
    for part in envs.parts:
        estimator.onboard(part)
    frames = [frame_from_observation(row(observations, k)) for k in range(2)]
    detections = [
        SegmentationDetector(instance_parts=envs.instance_part_names(k)).detect(frame, envs.parts)
        for k, frame in enumerate(frames)
    ]
    frames, detections = [*frames, frames[0]], [*detections, []]
    batch = validated_estimates(estimator, frames, detections)
    assert [len(estimates) for estimates in batch] == [len(found) for found in detections]
    for frame, found, together in zip(frames, detections, batch, strict=True):
        for alone, estimate in zip(estimator.estimate(frame, found), together, strict=True):
            assert alone.part == estimate.part and alone.detection is estimate.detection
            np.testing.assert_allclose(alone.T_camera_part, estimate.T_camera_part, atol=1e-5)


@pytest.mark.render
def test_a_shared_estimator_is_asked_once_if_it_can_batch_and_frame_by_frame_if_not(envs) -> None:
    class Batching(Counting):
        def estimate_batch(self, frames, detections) -> list[list[PoseEstimate]]:
            self.frames.append(tuple(frames))
            return [Counting.estimate(Counting(), f, d) for f, d in zip(frames, detections, strict=True)]

    observations, _ = envs.reset(seed=5)
    frames = [frame_from_observation(row(observations, k)) for k in range(2)]
    for estimator, calls in ((Counting(), 2), (Batching(), 1)):
        perceptions = [
            Perception("x", SegmentationDetector(instance_parts=envs.instance_part_names(k)), estimator)
            for k in range(2)
        ]
        percepts = perceive_together(perceptions, frames, envs.parts)
        assert len(estimator.frames) == calls
        for k, percept in enumerate(percepts):
            alone = perceptions[k].perceive(frames[k], envs.parts)
            assert [d.instance for d in percept.detections] == [d.instance for d in alone.detections]
            assert len(percept.estimates) == len(percept.detections) > 0


@pytest.mark.render
def test_other_environments_and_modes_are_refused(envs) -> None:
    with pytest.raises(ConfigError, match="one perception for each of the 2 environments, got 1"):
        PoseVectorObservation(envs, make_vector_perceptions(TRUE_POSES, envs, rngs()[:1]))
    with pytest.raises(ConfigError, match="perceptions must hold one for each environment, got none"):
        VectorPickPolicy([], envs.parts, SCENE)
    same_step = BinPickVectorEnv(1, scene_config=SCENE, autoreset_mode="SameStep")
    with pytest.raises(ConfigError, match="needs autoreset_mode NextStep or Disabled, got SameStep"):
        PoseVectorObservation(same_step, make_vector_perceptions(TRUE_POSES, same_step, rngs()[:1]))
    same_step.close()


@pytest.mark.render
def test_the_benchmark_compares_numbers_of_environments(capsys) -> None:
    assert main(["benchmark", "--parts", "hex_bolt", "--count", "1", "--envs", "2"]) == 0
    table = capsys.readouterr().out
    assert "episodes/h" in table and "1 parts, jaw, oracle" in table
    assert main(["benchmark", "--envs", "0"]) != 0
    assert "envs must be numbers of 1 or more, got 0" in capsys.readouterr().err
