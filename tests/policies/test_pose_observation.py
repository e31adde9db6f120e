"""`PoseObservation` adds what perception estimates, and nothing else changes."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import FilterObservation

from simpick.envs.actions import ABSTAIN
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_servo import BinServoEnv
from simpick.errors import ConfigError
from simpick.estimators.oracle import OracleEstimator
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.policies import Perception, PoseObservation
from simpick.policies.pose_observation import MAX_SCORE, POSE_TABLE
from simpick.records import Detection, PoseEstimate
from simpick.scene.config import MAX_PARTS
from tests.small_scenes import small_scene

CONFIG = small_scene("hex_bolt", "pipe_tee", count=3)


def oracle(env: BinPickEnv) -> Perception:
    detector = SegmentationDetector(instance_parts=env.instance_part_names, min_visible_px=4)
    return Perception("oracle", detector, OracleEstimator(env.truth))


class Shouting:
    """An estimator with boundless scores."""

    def __init__(self) -> None:
        self.onboarded: list[str] = []

    def onboard(self, part) -> None:
        self.onboarded.append(part.name)

    def estimate(self, frame, detections) -> list[PoseEstimate]:
        return [PoseEstimate(d.part, np.eye(4), 1e9, "shouting", 0.0, detection=d) for d in detections]


class Crowd:
    """A detector that sees more parts than a bin holds."""

    def detect(self, frame, parts) -> list[Detection]:
        box = np.array([0.0, 0.0, 8.0, 8.0])
        return [Detection(parts[0].name, box, None, 0.5) for _ in range(2 * MAX_PARTS)]


@pytest.fixture
def env():
    env = BinPickEnv(scene_config=CONFIG)
    yield env
    env.close()


@pytest.mark.render
def test_the_oracle_s_poses_are_the_truth_in_the_world_frame(env) -> None:
    wrapped = PoseObservation(env, oracle(env))
    observation, info = wrapped.reset(seed=0)
    named = observation["estimated_parts"] >= 0
    assert named.sum() == 3 and named[:3].all()
    estimated = observation["estimated_poses"][named]
    true = info["truth"]["T_world_part"]
    order = [int(np.argmin(np.abs(true - pose).sum(axis=(1, 2)))) for pose in estimated]
    assert sorted(order) == [0, 1, 2]
    np.testing.assert_allclose(estimated, true[order], atol=1e-9)
    names = [env.part_names[k] for k in observation["estimated_parts"][named]]
    assert names == [env.instance_part_names()[k] for k in order]
    assert not observation["estimated_poses"][3:].any() and not observation["estimate_scores"][3:].any()
    assert (np.diff(observation["estimate_scores"]) <= 0).all() and observation["estimate_scores"][0] == 1


@pytest.mark.render
def test_the_environment_s_own_observation_stays_as_it_is(env) -> None:
    plain, _ = env.reset(seed=1)
    wrapped = PoseObservation(env, oracle(env))
    observation, _ = wrapped.reset(seed=1)
    assert all(np.array_equal(observation[key], plain[key]) for key in plain)
    assert set(observation) - set(plain) == {item.key for item in POSE_TABLE}
    assert isinstance(wrapped.observation_space, spaces.Dict)
    assert set(wrapped.observation_space.spaces) == set(observation)
    assert set(env.observation_space) == set(plain)


@pytest.mark.render
def test_a_step_is_perceived_anew(env) -> None:
    wrapped = PoseObservation(env, oracle(env))
    first, _ = wrapped.reset(seed=0)
    seen = wrapped.percept
    second, *_ = wrapped.step(ABSTAIN)
    assert wrapped.percept is not seen and second["last_outcome"] > 0
    assert not np.shares_memory(first["estimated_poses"], second["estimated_poses"])
    np.testing.assert_array_equal(first["estimated_poses"], second["estimated_poses"])


@pytest.mark.render
# gymnasium checks wrapped environments too, but says each time that it would rather not.
@pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version:UserWarning")
def test_gymnasium_accepts_it(env) -> None:
    check_env(PoseObservation(env, oracle(env)), skip_render_check=True)


@pytest.mark.render
def test_more_estimates_than_fit_and_boundless_values_stay_in_the_space(env) -> None:
    estimator = Shouting()
    wrapped = PoseObservation(env, Perception("shouting", Crowd(), estimator))
    assert estimator.onboarded == list(env.part_names)
    observation, _ = wrapped.reset(seed=0)
    assert observation in wrapped.observation_space
    assert (observation["estimated_parts"] >= 0).sum() == MAX_PARTS
    assert observation["estimate_scores"][0] == MAX_SCORE


def test_other_environments_are_refused() -> None:
    env = BinServoEnv(parts=("hex_bolt",), images=())
    detector = SegmentationDetector(instance_parts=[])
    perception = Perception("oracle", detector, OracleEstimator(env.truth))
    with pytest.raises(ConfigError, match=r"needs an environment simpick/BinPick-v0, got BinServoEnv"):
        PoseObservation(env, perception)


def test_observations_that_were_dropped_are_missed(env) -> None:
    blind: gymnasium.Env = FilterObservation(env, ["rgb", "remaining"])
    with pytest.raises(ConfigError, match=r"but depth, segmentation, camera_matrix, T_world_camera is missing"):
        PoseObservation(blind, oracle(env))
