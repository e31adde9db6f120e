"""The boundary of perception: no truth goes in, no wrong answer comes out."""

import dataclasses
import time
from typing import Any

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.errors import CheckpointError, PluginError
from simpick.estimators.boundary import (
    onboard_part,
    validated_detections,
    validated_estimates,
    validated_foreground,
    validated_refinements,
)
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.geometry import Pinhole
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

NUT = get_part("hex_nut")
FRAME = CameraFrame(
    np.zeros((24, 32, 3), np.uint8),
    Pinhole(32, 24, 30.0, 30.0, 16.0, 12.0),
    np.eye(4),
    depth_m=np.ones((24, 32), np.float32),
    instances=np.zeros((24, 32), np.int32),
)
MASK = np.ones((24, 32), bool)
GOOD = Detection("hex_nut", np.array([0.0, 0.0, 32.0, 24.0]), MASK, 0.5)


class Detects:
    """Returns what it was given, or raises it; keeps the frame that it saw."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def detect(self, frame, parts) -> Any:
        self.frame = frame
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


class Estimates:
    """Answers each detection with changes of a good estimate."""

    def __init__(self, **changes) -> None:
        self.changes = changes

    def onboard(self, part):
        pass

    def estimate(self, frame, detections):
        self.frame = frame
        good = [PoseEstimate(d.part, pose(), 0.5, "mine", 0.0, detection=d) for d in detections]
        for estimate in good:
            for name, value in self.changes.items():
                # Not through the constructor, whose types are checked in tests only.
                object.__setattr__(estimate, name, value)
        return good


def pose(scale: float = 1.0, distance_m: float = 0.8) -> np.ndarray:
    T = np.diag([scale, scale, scale, 1.0])
    T[2, 3] = distance_m
    return T


def test_plug_ins_see_neither_depth_nor_instance_ids() -> None:
    detector, estimator = Detects([GOOD]), Estimates()
    found = validated_detections(detector, FRAME, [NUT])
    validated_estimates(estimator, [FRAME], [found])
    for frame in (detector.frame, estimator.frame):
        assert frame.depth_m is None and frame.instances is None
        assert frame.rgb is FRAME.rgb


def test_the_simulator_s_segmentation_sees_instance_ids() -> None:
    (found,) = validated_detections(SegmentationDetector(instance_parts=["hex_nut"]), FRAME, [NUT])
    assert found.instance == 0


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "a list of detections must be returned, got NoneType"),
        ([None], "detections must be returned, got NoneType"),
        (
            [dataclasses.replace(GOOD, part="cube")],
            r"must be of the parts asked for \(hex_nut\), got 'cube'",
        ),
        ([dataclasses.replace(GOOD, score=np.nan)], "probabilities from 0 to 1, got nan"),
        ([dataclasses.replace(GOOD, score=1.5)], "probabilities from 0 to 1, got 1.5"),
        ([dataclasses.replace(GOOD, box_xyxy_px=np.array([0.0, 0, np.inf, 1]))], "boxes must be four finite numbers"),
        ([dataclasses.replace(GOOD, mask=MASK[:, :5])], r"of the image's size \(24, 32\), got bool of \(24, 5\)"),
        (ZeroDivisionError("oh"), "test_boundary.Detects failed: ZeroDivisionError: oh"),
    ],
)
def test_a_detector_s_fault_is_named(answer, text: str) -> None:
    with pytest.raises(PluginError, match=text) as caught:
        validated_detections(Detects(answer), FRAME, [NUT])
    assert "detector tests.estimators.test_boundary.Detects" in str(caught.value)


class Segments(Detects):
    """Also returns the answer as foreground."""

    def foreground(self, frame) -> Any:
        return self.detect(frame, ())


def test_the_foreground_is_asked_for_without_the_truth() -> None:
    detector = Segments(MASK)
    assert validated_foreground(detector, FRAME) is MASK
    assert detector.frame.depth_m is None and detector.frame.instances is None


def test_detectors_need_not_know_the_foreground() -> None:
    assert validated_foreground(Detects([GOOD]), FRAME) is None
    assert validated_foreground(SegmentationDetector(instance_parts=["hex_nut"]), FRAME) is None


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "a foreground mask must be returned, got NoneType"),
        (MASK.astype(float), "the foreground must be boolean .* got float64"),
        (MASK[:5], r"of the image's size \(24, 32\), got bool of \(5, 32\)"),
        (ZeroDivisionError("oh"), "test_boundary.Segments failed: ZeroDivisionError: oh"),
    ],
)
def test_a_wrong_foreground_is_named(answer, text: str) -> None:
    with pytest.raises(PluginError, match=text):
        validated_foreground(Segments(answer), FRAME)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"T_camera_part": pose()[:3]}, r"got an array of shape \(3, 4\)"),
        ({"T_camera_part": pose() * np.nan}, "got NaN or infinity"),
        ({"T_camera_part": pose(scale=2.0)}, "got a matrix that is no rotation"),
        ({"T_camera_part": np.diag([1.0, 1.0, -1.0, 1.0])}, "got a matrix that is no rotation"),
        ({"T_camera_part": pose(distance_m=1e12)}, r"got a part 1e\+12 m away"),
        ({"T_camera_part": None}, "got no array of floating-point numbers, but None"),
        ({"part": "cube"}, "must be of its detection's part 'hex_nut', got 'cube'"),
        ({"hypotheses": (PoseHypothesis(pose(), np.nan),)}, "scores of estimates must be finite, got nan"),
        ({"hypotheses": (PoseHypothesis(pose(scale=0.5), 1.0),)}, "got a matrix that is no rotation"),
        ({"score": np.inf}, "scores of estimates must be finite, got inf"),
        ({"detection": None}, "each estimate must answer one of the detections"),
    ],
)
def test_an_estimator_s_fault_is_named(changes: dict, text: str) -> None:
    with pytest.raises(PluginError, match=text) as caught:
        validated_estimates(Estimates(**changes), [FRAME], [[GOOD]])
    assert "estimator tests.estimators.test_boundary.Estimates" in str(caught.value)


class Answers:
    """Returns, or raises, whatever it was given."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def onboard(self, part):
        self.estimate(None, [])

    def estimate(self, frame, detections) -> Any:
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def refine(self, frame, detections, hypotheses) -> Any:
        return self.estimate(frame, detections)


ESTIMATE = PoseEstimate("hex_nut", pose(), 0.5, "mine", 0.0, detection=GOOD)


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "a list of estimates must be returned, got NoneType"),
        ([None], "estimates must be returned, got NoneType"),
        ([ESTIMATE] * 50, "each detection at most once"),
        (ZeroDivisionError("oh"), "test_boundary.Answers failed: ZeroDivisionError: oh"),
    ],
)
def test_an_estimator_s_answer_of_another_kind_is_named(answer, text: str) -> None:
    with pytest.raises(PluginError, match=text):
        validated_estimates(Answers(answer), [FRAME], [[GOOD]])


def test_a_batch_has_an_answer_per_frame() -> None:
    class Batch(Answers):
        def estimate_batch(self, frames, detections) -> Any:
            return self.answer

    for answer, text in ((None, "a list of estimates for each frame"), ([[ESTIMATE]], "of 2 frames must be returned")):
        with pytest.raises(PluginError, match=text):
            validated_estimates(Batch(answer), [FRAME, FRAME], [[GOOD], []])


@pytest.mark.parametrize(
    ("answer", "text"),
    [
        (None, "a list of refined hypotheses must be returned, got NoneType"),
        ([], "hypotheses of 1 detections must be returned, got 0"),
        ([None], "a tuple of hypotheses for each detection must be returned, got NoneType"),
        ([(PoseHypothesis(pose(scale=2.0), 1.0),)], "got a matrix that is no rotation"),
        (ZeroDivisionError("oh"), "the refiner tests.estimators.test_boundary.Answers failed: ZeroDivisionError: oh"),
    ],
)
def test_a_refiner_s_fault_is_named(answer, text: str) -> None:
    with pytest.raises(PluginError, match=text):
        validated_refinements(Answers(answer), FRAME, [GOOD], [[PoseHypothesis(pose(), 1.0)]])


def test_an_exception_in_onboard_is_named() -> None:
    with pytest.raises(PluginError, match=r"plug-in tests\.estimators\.test_boundary\.Answers failed: OSError: full"):
        onboard_part(Answers(OSError("full")), NUT)


def test_no_answer_in_time_is_an_error_that_names_the_plug_in(monkeypatch: pytest.MonkeyPatch) -> None:
    class Hangs(Answers):
        def detect(self, frame, parts) -> Any:
            time.sleep(60)

        def estimate(self, frame, detections):
            while True:
                pass

    monkeypatch.setenv("SIMPICK_TIME_LIMIT_S", "0.05")
    plugin = Hangs(None)
    for role, ask in (
        ("detector", lambda: validated_detections(plugin, FRAME, [NUT])),
        ("estimator", lambda: validated_estimates(plugin, [FRAME], [[GOOD]])),
        ("refiner", lambda: validated_refinements(plugin, FRAME, [GOOD], [[]])),
        ("plug-in", lambda: onboard_part(plugin, NUT)),
    ):
        expected = rf"^the {role} .*Hangs gave no answer in 0\.05 s\. .* variable SIMPICK_TIME_LIMIT_S$"
        with pytest.raises(PluginError, match=expected):
            ask()


def test_errors_that_are_meant_for_people_pass_unchanged() -> None:
    with pytest.raises(CheckpointError, match=r"^no weights$"):
        validated_detections(Detects(CheckpointError("no weights")), FRAME, [NUT])
