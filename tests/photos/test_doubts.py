"""What is said where a part may not be in the image."""

from collections.abc import Iterator

import numpy as np
import pytest

from simpick.assets import get_part
from simpick.estimators import LearnedDetector
from simpick.estimators.detections import photo_detector
from simpick.geometry import Pinhole
from simpick.photos import PhotoEstimator
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.photos.photo_estimator import PhotoPoses
from simpick.records import CameraFrame, PoseEstimate


@pytest.fixture(scope="module")
def estimator() -> Iterator[PhotoEstimator]:
    with PhotoEstimator([get_part("hex_bolt"), get_part("hex_nut")], "retrieval") as estimator:
        yield estimator


def poses(scores: dict[str, list[float]]) -> PhotoPoses:
    camera = Pinhole(64, 48, 80.0, 80.0, 32.0, 24.0)
    frame = CameraFrame(np.zeros((48, 64, 3), np.uint8), camera, np.eye(4))
    T = np.eye(4)
    T[2, 3] = 0.5
    estimates = [
        CadPoseEstimate.of(PoseEstimate(name, T, score, "retrieval", 0.1), get_part(name))
        for name, own in scores.items()
        for score in own
    ]
    return PhotoPoses(frame, (), tuple(estimates), {})


def test_a_part_without_a_probable_pose_may_not_be_in_the_image(
    estimator: PhotoEstimator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(estimator, "gives_probabilities", True)
    (doubt,) = estimator.doubts(poses({"hex_bolt": [0.1, 0.9], "hex_nut": [0.3, 0.24]}))
    assert doubt.startswith(
        "hex_nut: the most probable pose has a probability of 0.30 only; the part may not be in the"
    )


def test_scores_that_are_no_probabilities_raise_no_doubt(estimator: PhotoEstimator) -> None:
    assert not estimator.gives_probabilities
    assert estimator.doubts(poses({"hex_bolt": [0.1], "hex_nut": [0.2]})) == []


def test_a_part_that_is_missing_beside_others_is_named(estimator: PhotoEstimator) -> None:
    assert estimator.doubts(poses({"hex_bolt": [0.9]})) == ["hex_nut: not found in this image"]
    assert estimator.doubts(poses({})) == [], "`simpick estimate` says what to do where nothing is found at all"


def test_photographs_are_searched_however_improbable_the_part_is() -> None:
    detector = photo_detector("learned")
    assert isinstance(detector, LearnedDetector) and (detector.config.min_presence, detector.config.min_score) == (
        0,
        0.1,
    )
    assert LearnedDetector().config.min_presence == 0.5


def test_nothing_is_left_out_where_it_is_known_how_many_there_are() -> None:
    detector = photo_detector("learned", counted=True)
    assert isinstance(detector, LearnedDetector)
    assert (detector.config.min_presence, detector.config.min_score) == (0, 0)
