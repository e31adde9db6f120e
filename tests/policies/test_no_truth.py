"""Nothing of the simulator's truth reaches a decision: neither instance ids nor depth."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simpick import compare
from simpick.envs.bin_env import BinEnv
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.observations import frame_from_observation
from simpick.estimators import LearnedDetector, load_estimator
from simpick.estimators.registry import SHIPPED
from simpick.experiments import CompareConfig
from simpick.policies import Perception, PickPolicy
from simpick.records import CameraFrame

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def env() -> Iterator[BinPickEnv]:
    with_two_tees = BinPickEnv(parts=["pipe_tee"], count=2)
    yield with_two_tees
    with_two_tees.close()


@pytest.fixture(scope="module")
def observation(env: BinPickEnv) -> dict:
    return env.reset(seed=1)[0]


@pytest.fixture(scope="module")
def detector() -> LearnedDetector:
    return LearnedDetector()


@pytest.mark.parametrize("name", SHIPPED)
def test_each_estimator_answers_a_frame_without_ids_and_depth_the_same(
    name: str, env: BinPickEnv, observation: dict, detector: LearnedDetector
) -> None:
    frame = frame_from_observation(observation)
    perception = Perception(name, detector, load_estimator(name))
    perception.onboard(env.parts)
    with_truth = perception.perceive(frame, env.parts)
    without = perception.perceive(replace(frame, instances=None, depth_m=None), env.parts)
    assert len(with_truth.estimates) == len(without.estimates) > 0
    for a, b in zip(with_truth.estimates, without.estimates, strict=True):
        np.testing.assert_array_equal(a.T_camera_part, b.T_camera_part)
        assert (a.part, a.score) == (b.part, b.score)
        assert a.detection is not None and a.detection.instance is None


def test_the_policy_acts_on_the_image_alone(env: BinPickEnv, observation: dict, detector: LearnedDetector) -> None:
    policy = PickPolicy(Perception("retrieval", detector, load_estimator("retrieval")), env.parts, env.scene_config)
    action = policy.act(observation)
    assert policy.decision.grasp is not None
    policy.reset()
    scrambled = {
        "depth": np.full_like(observation["depth"], 0.3),
        "segmentation": np.zeros_like(observation["segmentation"]),
        "instance_parts": np.full_like(observation["instance_parts"], -1),
    }
    np.testing.assert_array_equal(policy.act({**observation, **scrambled}), action)


def test_permuted_ids_and_another_depth_change_nothing_in_a_whole_comparison(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = CompareConfig(modes=("refined",), parts=("pipe_tee",), count=2, episodes=1, seed=1)
    before = [result.to_json(timings=False) for result in compare(config, tmp_path / "before").results]
    assert before[0]["picks"]
    capture, captured = BinEnv.capture, []

    def scrambled(self: BinEnv, camera: str = "overhead") -> CameraFrame:
        frame = capture(self, camera)
        assert frame.instances is not None and frame.depth_m is not None
        # Two instances change their numbers; -1, the background, stays.
        swapped = np.array([1, 0, -1], np.int32)[frame.instances]
        captured.append((swapped != frame.instances).any())
        return replace(frame, instances=swapped, depth_m=np.full_like(frame.depth_m, 0.3))

    monkeypatch.setattr(BinEnv, "capture", scrambled)
    after = [result.to_json(timings=False) for result in compare(config, tmp_path / "after").results]
    assert any(captured)
    assert after == before
