"""A second look from the wrist corrects the grasp before the descent, within limits."""

import numpy as np
import pytest

from simpick.envs.bin_pick import BinPickEnv
from simpick.errors import ConfigError
from simpick.estimators.base import PoseRefiner
from simpick.estimators.oracle import OracleEstimator, OracleRefiner, PoseNoise
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import run_configured_episode
from simpick.geometry import Pinhole, invert
from simpick.policies import Perception, PickPolicy
from simpick.policies.closer_look import CloserLook
from simpick.recording.base import NullRecorder
from simpick.records import CameraFrame, PickOutcome
from tests.small_scenes import small_scene

SCENE = small_scene("pipe_tee", "hex_bolt", count=2, width_px=320, height_px=240)


class Hesitant:
    """A refiner that never answers."""

    def onboard(self, part) -> None:
        pass

    def refine(self, frame, detections, hypotheses) -> list:
        return [() for _ in detections]


@pytest.fixture
def env():
    env = BinPickEnv(scene_config=SCENE)
    yield env
    env.close()


def policy_for(env: BinPickEnv, refiner, noise_mm: float) -> PickPolicy:
    rng = np.random.default_rng(3)
    detector = SegmentationDetector(instance_parts=env.instance_part_names, min_visible_px=16)
    oracle = OracleEstimator(env.truth, PoseNoise(2.0, noise_mm), rng)
    return PickPolicy(Perception("oracle", detector, oracle), env.parts, SCENE, look_closer=refiner)


@pytest.mark.render
def test_a_blurred_estimate_is_corrected_before_the_descent(env) -> None:
    refiner = OracleRefiner(env.truth, PoseNoise(0.2, 0.3), np.random.default_rng(0))
    assert isinstance(refiner, PoseRefiner)
    policy = policy_for(env, refiner, noise_mm=12.0)
    observation, _ = env.reset(seed=0)
    corrections = []

    def look(frame, T_world_tcp):
        corrected = policy.look(frame, T_world_tcp)
        corrections.append((T_world_tcp, corrected))
        assert frame.rgb.shape[:2] == (SCENE.wrist.height_px, SCENE.wrist.width_px)
        return corrected

    env.on_look = look
    action = policy.act(observation)
    assert policy.decision is not None
    target = policy.decision.target
    assert target is not None and target.detection is not None
    instance = target.detection.instance
    true = next(t.T_world_part for t in env.truth() if t.instance == instance)
    *_, info = env.step(action)
    ((aimed, corrected),) = corrections
    T_world_estimate = policy.decision.frame.T_world_camera @ target.T_camera_part
    offset_mm = 1e3 * np.linalg.norm(T_world_estimate[:3, 3] - true[:3, 3])
    assert offset_mm > 4 and 1e3 * np.linalg.norm(corrected[:3, 3] - aimed[:3, 3]) > 3
    # On the refined part, the TCP stands where it stood on the estimated one.
    part = next(part for part in env.parts if part.name == target.part)
    T_part_tcp = invert(part.symmetries.closest_equivalent(true, T_world_estimate)) @ corrected
    np.testing.assert_allclose(T_part_tcp, invert(T_world_estimate) @ aimed, atol=0.02)
    np.testing.assert_allclose(T_part_tcp[:3, 3], (invert(T_world_estimate) @ aimed)[:3, 3], atol=1.5e-3)
    assert policy.closer_view is not None and policy.closer_view.detection is not None
    assert policy.closer_view.detection.instance == instance
    assert info["pick"].stages[:3] == ("approach", "look", "descend")
    assert info["pick"].outcome is PickOutcome.SUCCESS


@pytest.mark.render
@pytest.mark.parametrize("shift_m", [0.1, None])
def test_what_is_far_off_or_nothing_leaves_the_grasp_as_it_was(env, shift_m) -> None:
    policy = policy_for(env, None, noise_mm=0.0)
    outcomes = []
    for looks in (False, True):
        observation, _ = env.reset(seed=0)
        policy.reset()

        def look(frame, T_world_tcp):
            if shift_m is None:
                return None
            moved = T_world_tcp.copy()
            moved[0, 3] += shift_m
            return moved

        env.on_look = look if looks else None
        estimator = policy.perception.estimator
        assert isinstance(estimator, OracleEstimator)
        estimator._rng = np.random.default_rng(3)
        *_, info = env.step(policy.act(observation))
        outcomes.append(info)
    assert ("look" in outcomes[1]["pick"].stages) and "look" not in outcomes[0]["pick"].stages
    assert outcomes[0]["pick"].delivered == outcomes[1]["pick"].delivered != ()


@pytest.mark.render
def test_a_target_that_is_not_where_it_is_expected_is_not_mistaken_for_another(env) -> None:
    env.reset(seed=0)
    detector = SegmentationDetector(instance_parts=env.instance_part_names, min_visible_px=16)
    frame = env.capture("overhead")
    closer = CloserLook(OracleRefiner(env.truth), detector, env.parts)
    truth = env.truth()[0]
    found = closer.refined(frame, truth.part, truth.T_world_part)
    assert found is not None and found.detection is not None
    assert found.detection.instance == truth.instance and found.mode == "closer_look"
    elsewhere = truth.T_world_part.copy()
    elsewhere[:2, 3] += 0.4
    assert closer.refined(frame, truth.part, elsewhere) is None
    behind = truth.T_world_part.copy()
    behind[2, 3] += 5.0
    assert closer.refined(frame, truth.part, behind) is None
    assert CloserLook(Hesitant(), detector, env.parts).refined(frame, truth.part, truth.T_world_part) is None


@pytest.mark.render
def test_a_run_records_what_the_wrist_saw() -> None:
    class Listening(NullRecorder):
        def __init__(self) -> None:
            self.cameras, self.modes = [], []

        def frame(self, camera, frame) -> None:
            self.cameras.append(camera)

        def estimates(self, T_world_camera, estimates) -> None:
            self.modes += [estimate.mode for estimate in estimates]

    recorder = Listening()
    config = RunConfig(estimator="oracle", parts=("pipe_tee",), count=1, noise_mm=8.0, look_closer=True)
    result = run_configured_episode(config, 0, recorder=recorder)
    assert recorder.cameras[:2] == ["overhead", "wrist"] and recorder.modes[:2] == ["oracle", "closer_look"]
    assert "look" in result.picks[0].stages
    assert result.mode == "oracle_noise@8mm+closer"
    error = result.picks[0].pose_error
    assert error is not None and error.translation_mm < 0.1, "the error is that of the pose that was picked by"


def test_looking_closer_needs_a_refiner() -> None:
    env = BinPickEnv(scene_config=SCENE)
    with pytest.raises(ConfigError, match=r"look needs a policy with a refiner: PickPolicy\(\.\.\., look_closer"):
        frame = CameraFrame(np.zeros((4, 4, 3), np.uint8), Pinhole(4, 4, 4.0, 4.0, 2.0, 2.0), np.eye(4))
        policy_for(env, None, 0.0).look(frame, np.eye(4))
