"""A pick without a grasp says which step left nothing."""

from collections import Counter

import numpy as np
import pytest

from simpick.experiments.episodes import cause_of_abstention
from simpick.geometry import Pinhole
from simpick.grasping import Rejection
from simpick.policies import Decision, Percept
from simpick.records import CameraFrame, Detection, PickOutcome, PoseEstimate

FRAME = CameraFrame(np.zeros((24, 32, 3), np.uint8), Pinhole(32, 24, 30.0, 30.0, 16.0, 12.0), np.eye(4))
DETECTION = Detection("hex_nut", np.array([0.0, 0.0, 8.0, 8.0]), None, 0.9)
ESTIMATE = PoseEstimate("hex_nut", np.eye(4), 0.5, "x", 0.0, detection=DETECTION)
SOME_PX = np.arange(24 * 32).reshape(24, 32) < 70


def decision(percept: Percept, **rejected: int) -> Decision:
    why = PickOutcome.NO_GRASP if percept.detections else PickOutcome.NOTHING_DETECTED
    return Decision(percept, FRAME, None, why, Counter({Rejection[name]: n for name, n in rejected.items()}), 0.0)


@pytest.mark.parametrize(
    ("percept", "rejected", "cause"),
    [
        (Percept((), (), {}), {}, "look: the detector found no part"),
        (Percept((), (), {}, SOME_PX), {}, "look: the detector found no part, though 70 px show parts"),
        (
            Percept((), (), {}, SOME_PX, 80),
            {},
            "look: the detector found no part, though 70 px show parts; it needs 80 px of one",
        ),
        (Percept((DETECTION,), (), {}), {}, "estimate: none of the 1 detections got a pose"),
        (
            Percept((DETECTION,), (ESTIMATE,), {}),
            {"TILT": 9, "PARTS": 40, "BIN": 0, "REACH": 2},
            "plan: no grasp is left on the 1 estimated parts: 40 meet other parts, 9 tilted too far, 2 out of reach",
        ),
        (Percept((DETECTION,), (ESTIMATE,), {}), {}, "plan: no grasp is left on the 1 estimated parts: they have none"),
    ],
)
def test_the_cause_names_the_step_and_the_filters(percept: Percept, rejected: dict[str, int], cause: str) -> None:
    assert cause_of_abstention(decision(percept, **rejected)) == cause
