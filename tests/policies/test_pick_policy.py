"""What `PickPolicy` decides on images that never come from a simulator: after a failure, and when nothing is left."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.envs.actions import ABSTAIN
from simpick.envs.spaces import outcome_index
from simpick.geometry import Pinhole, invert, look_at, so3_exp, transform
from simpick.grasping import Rejection
from simpick.policies import Perception, PickPolicy
from simpick.records import CameraFrame, Detection, PickOutcome, PoseEstimate, PoseHypothesis
from simpick.scene import SceneConfig

PART = get_part("crane_hook")
T_WORLD_CAMERA = look_at(np.array([0.5, 0.0, 0.9]), np.array([0.5, 0.0, 0.0]))
CAMERA = Pinhole(160, 120, 240.0, 240.0, 80.0, 60.0)
FLAT = transform(so3_exp(np.array([np.pi / 2, 0.0, 0.0])), np.array([0.5, 0.0, 0.006]))
TURNED = transform(so3_exp(np.array([0.0, 0.0, np.pi / 2]))) @ FLAT
TURNED[:3, 3] = FLAT[:3, 3]


class Scripted:
    """Detects one part, and estimates it with the given poses as hypotheses; nothing where there are none."""

    def __init__(self, *Ts_world_part: np.ndarray, detected: bool = True) -> None:
        self._poses, self._detected = Ts_world_part, detected

    def onboard(self, part) -> None:
        pass

    def detect(self, frame: CameraFrame, parts: Sequence) -> list[Detection]:
        return [Detection(PART.name, np.array([70.0, 50.0, 90.0, 70.0]), None, 1.0)] if self._detected else []

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        hypotheses = tuple(PoseHypothesis(invert(T_WORLD_CAMERA) @ T, 0.5) for T in self._poses)
        return [
            PoseEstimate(PART.name, hypotheses[0].T_camera_part, 0.5, "scripted", 0.0, hypotheses, detection)
            for detection in (detections if hypotheses else ())
        ]


def policy(scripted: Scripted) -> PickPolicy:
    return PickPolicy(Perception("scripted", scripted, scripted), [PART], SceneConfig(parts=(PART.name,), count=1))


def seen(last: PickOutcome | None = None, changed: bool = False) -> dict[str, Any]:
    rgb = np.full((120, 160, 3), 90, np.uint8)
    if changed:
        rgb[50:70, 70:90] = 150
    return {
        "rgb": rgb,
        "depth": np.ones((120, 160), np.float32),
        "segmentation": np.zeros((120, 160), np.uint8),
        "camera_matrix": CAMERA.K,
        "T_world_camera": T_WORLD_CAMERA,
        "last_outcome": np.int64(outcome_index(last)),
    }


def target_angle_deg(deciding: PickPolicy) -> float:
    T = deciding.decision.T_world_target
    assert T is not None
    return float(np.degrees(np.arccos(np.clip((np.trace(T[:3, :3].T @ FLAT[:3, :3]) - 1) / 2, -1, 1))))


def test_after_a_miss_the_next_hypothesis_is_tried_and_then_nothing() -> None:
    deciding = policy(Scripted(FLAT, TURNED))
    deciding.act(seen())
    assert target_angle_deg(deciding) == pytest.approx(0, abs=0.1)
    deciding.act(seen(PickOutcome.MISSED))
    assert target_angle_deg(deciding) == pytest.approx(90, abs=0.1)
    np.testing.assert_array_equal(deciding.act(seen(PickOutcome.MISSED)), ABSTAIN)
    assert deciding.decision.abstained is PickOutcome.NO_GRASP
    assert deciding.decision.rejected[Rejection.FAILED] > 0


def test_after_a_miss_a_pose_is_tried_again_once_its_image_has_changed() -> None:
    deciding = policy(Scripted(FLAT))
    deciding.act(seen())
    np.testing.assert_array_equal(deciding.act(seen(PickOutcome.MISSED)), ABSTAIN)
    deciding.act(seen(PickOutcome.NO_GRASP, changed=True))
    assert target_angle_deg(deciding) == pytest.approx(0, abs=0.1)


def test_after_a_collision_another_grasp_of_the_same_pose_is_tried() -> None:
    deciding = policy(Scripted(FLAT, TURNED))
    deciding.act(seen())
    first = deciding.decision.grasp
    deciding.act(seen(PickOutcome.COLLISION))
    second = deciding.decision.grasp
    assert first is not None and second is not None and target_angle_deg(deciding) == pytest.approx(0, abs=0.1)
    assert np.abs(first.T_world_tcp - second.T_world_tcp).max() > 0.005


def test_a_new_episode_forgets() -> None:
    deciding = policy(Scripted(FLAT))
    deciding.act(seen())
    deciding.reset()
    deciding.act(seen())
    assert deciding.decision.grasp is not None


def test_nothing_detected_and_nothing_estimated_differ() -> None:
    blind = policy(Scripted(detected=False))
    blind.act(seen())
    assert blind.decision.abstained is PickOutcome.NOTHING_DETECTED
    vague = policy(Scripted())
    vague.act(seen())
    assert vague.decision.abstained is PickOutcome.NO_GRASP and not vague.decision.percept.estimates


def test_decisions_hold_no_truth() -> None:
    deciding = policy(Scripted(FLAT))
    deciding.act(seen())
    assert deciding.decision.frame.depth_m is None and deciding.decision.frame.instances is None
