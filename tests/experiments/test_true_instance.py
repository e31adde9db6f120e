"""Which instance a picked pose is scored against, if the detection names none."""

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.experiments.episodes import _true_instance
from simpick.geometry import transform
from simpick.metrics.models import EvaluationModel
from simpick.records import Detection, InstanceTruth, PoseEstimate

BOLT = get_part("hex_bolt")
TRUTH = (
    InstanceTruth(0, "hex_bolt", transform(translation=np.array([0.10, 0.0, 0.0])), True),
    InstanceTruth(1, "hex_bolt", transform(translation=np.array([0.02, 0.0, 0.0])), True),
    InstanceTruth(2, "hex_nut", transform(translation=np.array([0.01, 0.0, 0.0])), True),
)


def target(instance: int | None) -> PoseEstimate:
    detection = Detection("hex_bolt", np.array([0.0, 0.0, 9.0, 9.0]), None, 0.5, instance)
    return PoseEstimate("hex_bolt", np.eye(4), 0.5, "mine", 0.0, detection=detection)


@pytest.mark.parametrize(("named", "expected"), [(0, 0), (None, 1), (7, None)])
def test_the_detection_decides_else_the_nearest_instance_of_the_part(named: int | None, expected: int | None) -> None:
    found = _true_instance(target(named), np.eye(4), TRUTH, EvaluationModel.of(BOLT))
    assert (None if found is None else found.instance) == expected


def test_a_part_of_which_nothing_is_left_has_no_instance() -> None:
    assert _true_instance(target(None), np.eye(4), TRUTH[2:], EvaluationModel.of(BOLT)) is None
