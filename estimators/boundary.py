"""The boundary of perception: detectors and estimators are asked here, without the truth, and answers are validated.

Every loop that runs perception asks through these functions: policies, benchmarks, data sets. A plug-in of another
package can therefore neither read the simulator's truth nor pass on a wrong answer: what it raises or returns wrongly
becomes a `PluginError` that names it, and so does no answer in time (`simpick.estimators.time_limit`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool

from simpick.activity import counted
from simpick.errors import PluginError, SimpickError
from simpick.estimators.base import (
    BatchPoseEstimator,
    Detector,
    ForegroundDetector,
    OnboardingDetector,
    PoseEstimator,
    PoseRefiner,
)
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.estimators.time_limit import VARIABLE, TimeLimitError, answer_limit_s, time_limit
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

if TYPE_CHECKING:
    from simpick.assets.part import Part

MAX_DISTANCE_M = 100.0
"""Poses farther from the camera than this are errors of the estimator."""
_IDENTITY = np.eye(3)
_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])


def without_truth(frame: CameraFrame) -> CameraFrame:
    """Return the frame as an image-based plug-in gets it: with neither depth nor instance ids."""
    return replace(frame, depth_m=None, instances=None)


def onboard_part(plugin: OnboardingDetector | PoseEstimator | PoseRefiner, part: Part) -> None:
    """Let a plug-in prepare for a part.

    Raises:
        PluginError: the plug-in raised something, or did not return in time.
        SimpickError: the plug-in raised it.
    """
    with _asked("plug-in", plugin):
        plugin.onboard(part)


def onboard_parts(plugins: Sequence[Detector | PoseEstimator | PoseRefiner], parts: Sequence[Part]) -> None:
    """Let plug-ins prepare for parts, one part after the other; detectors that need no preparation are left out.

    Raises:
        PluginError, SimpickError: as `onboard_part`.
    """
    preparing = [p for p in plugins if isinstance(p, OnboardingDetector) or not isinstance(p, Detector)]
    for part in counted(parts, "preparing part"):
        for plugin in preparing:
            onboard_part(plugin, part)


def validated_detections(detector: Detector, frame: CameraFrame, parts: Sequence[Part]) -> list[Detection]:
    """Return the validated detections of these parts; only the simulator's own segmentation gets instance ids.

    Raises:
        PluginError: the detector raised something, did not return in time, or returned something else than detections
            of these parts.
        SimpickError: the detector raised it.
    """
    seen = frame if isinstance(detector, SegmentationDetector) else without_truth(frame)
    with _asked("detector", detector):
        found = detector.detect(seen, parts)
        names = {part.name for part in parts}
        _check_type(found, list, "a list of detections")
        for detection in found:
            _check_type(detection, Detection, "detections")
            _check_detection(detection, frame, names)
    return found


def validated_foreground(detector: Detector, frame: CameraFrame) -> Bool[np.ndarray, "height width"] | None:
    """Return the pixels that show parts; None from a detector that does not know them.

    Raises:
        PluginError: the detector raised something, or returned something else than a mask of the image's size.
        SimpickError: the detector raised it.
    """
    if not isinstance(detector, ForegroundDetector):
        return None
    with _asked("detector", detector):
        foreground = detector.foreground(without_truth(frame))
        _check_type(foreground, np.ndarray, "a foreground mask")
        _check_mask(foreground, frame, "the foreground")
    return foreground


def validated_estimates(
    estimator: PoseEstimator, frames: Sequence[CameraFrame], detections: Sequence[Sequence[Detection]]
) -> list[list[PoseEstimate]]:
    """Return the validated estimates for each frame's detections: in one batch if the estimator can.

    Raises:
        PluginError: the estimator raised something, did not return in time, or returned something else than poses of
            these detections.
        SimpickError: the estimator raised it.
    """
    seen = [without_truth(frame) for frame in frames]
    with _asked("estimator", estimator, len(frames)):
        if isinstance(estimator, BatchPoseEstimator):
            answers = estimator.estimate_batch(seen, detections)
        else:
            answers = [estimator.estimate(frame, found) for frame, found in zip(seen, detections, strict=True)]
        _check_type(answers, list, "a list of estimates for each frame")
        if len(answers) != len(frames):
            raise _WrongAnswerError(f"estimates of {len(frames)} frames must be returned, got {len(answers)}")
        for estimates, found in zip(answers, detections, strict=True):
            _check_type(estimates, list, "a list of estimates")
            for estimate in estimates:
                _check_type(estimate, PoseEstimate, "estimates")
            _check_estimates(estimates, found)
    return answers


def validated_refinements(
    refiner: PoseRefiner,
    frame: CameraFrame,
    detections: Sequence[Detection],
    hypotheses: Sequence[Sequence[PoseHypothesis]],
) -> list[tuple[PoseHypothesis, ...]]:
    """Return the validated refined hypotheses of each detection.

    Raises:
        PluginError: the refiner raised something, did not return in time, or returned something else than poses.
        SimpickError: the refiner raised it.
    """
    with _asked("refiner", refiner):
        refined = refiner.refine(without_truth(frame), detections, hypotheses)
        _check_type(refined, list, "a list of refined hypotheses")
        if len(refined) != len(detections):
            raise _WrongAnswerError(f"hypotheses of {len(detections)} detections must be returned, got {len(refined)}")
        for best_first, detection in zip(refined, detections, strict=True):
            _check_type(best_first, tuple, "a tuple of hypotheses for each detection")
            for hypothesis in best_first:
                _check_type(hypothesis, PoseHypothesis, "hypotheses")
                _check_pose(hypothesis.T_camera_part, hypothesis.score, detection.part)
    return refined


def _check_detection(detection: Detection, frame: CameraFrame, names: set[str]) -> None:
    if detection.part not in names:
        raise _WrongAnswerError(
            f"detections must be of the parts asked for ({', '.join(sorted(names))}), got {detection.part!r}"
        )
    if not (np.isfinite(detection.score) and 0 <= detection.score <= 1):
        raise _WrongAnswerError(f"scores of detections must be probabilities from 0 to 1, got {detection.score}")
    box = np.asarray(detection.box_xyxy_px, float)
    if box.shape != (4,) or not np.isfinite(box).all():
        raise _WrongAnswerError(f"boxes must be four finite numbers x1, y1, x2, y2 in pixels, got {box.tolist()}")
    if detection.mask is not None:
        _check_mask(detection.mask, frame, "masks")


def _check_mask(mask: np.ndarray, frame: CameraFrame, what: str) -> None:
    size = frame.rgb.shape[:2]
    if mask.shape != size or mask.dtype != bool:
        raise _WrongAnswerError(
            f"{what} must be boolean and of the image's size {size}, got {mask.dtype} of {mask.shape}"
        )


def _check_estimates(estimates: Sequence[PoseEstimate], detections: Sequence[Detection]) -> None:
    answered: set[int] = set()
    asked = {id(detection) for detection in detections}
    for estimate in estimates:
        key = id(estimate.detection)
        if key not in asked or key in answered:
            raise _WrongAnswerError(
                "each estimate must answer one of the detections (PoseEstimate.detection), each detection at most once"
            )
        answered.add(key)
        assert estimate.detection is not None
        if estimate.part != estimate.detection.part:
            raise _WrongAnswerError(
                f"an estimate must be of its detection's part {estimate.detection.part!r}, got {estimate.part!r}"
            )
        for pose in (estimate, *estimate.hypotheses):
            _check_pose(pose.T_camera_part, pose.score, estimate.part)


def _check_pose(T_camera_part: object, score: float, part: str) -> None:
    if problem := _problem_of_pose(T_camera_part):
        raise _WrongAnswerError(f"poses of {part!r} must be T_camera_part in metres, got {problem}")
    if not np.isfinite(score):
        raise _WrongAnswerError(f"scores of estimates must be finite, got {score}")


def _problem_of_pose(T: object) -> str:
    """Return what is wrong with a pose, in words; empty if nothing is."""
    if not isinstance(T, np.ndarray) or T.dtype.kind != "f":
        return f"no array of floating-point numbers, but {T!r:.60}"
    if T.shape != (4, 4):
        return f"an array of shape {T.shape}"
    if not np.isfinite(T).all():
        return "NaN or infinity"
    if np.abs(T[3] - _LAST_ROW).max() > 1e-5:
        return f"the last row {T[3].tolist()}"
    R = T[:3, :3]
    if np.abs(R @ R.T - _IDENTITY).max() > 1e-3 or np.linalg.det(R) < 0:
        return "a matrix that is no rotation: scaled, sheared or mirrored"
    distance_m = float(np.linalg.norm(T[:3, 3]))
    return f"a part {distance_m:.3g} m away" if distance_m > MAX_DISTANCE_M else ""


class _WrongAnswerError(Exception):
    """What is wrong with an answer."""


def _check_type(value: object, kind: type, what: str) -> None:
    if not isinstance(value, kind):
        raise _WrongAnswerError(f"{what} must be returned, got {type(value).__name__}")


@contextmanager
def _asked(role: str, plugin: object, images: int = 1) -> Iterator[None]:
    """Limit how long a plug-in may take, and turn what it does wrong into an error that names it."""
    name = f"{type(plugin).__module__}.{type(plugin).__qualname__}"
    limit_s = images * answer_limit_s()
    try:
        with time_limit(limit_s):
            yield
    except TimeLimitError:
        raise PluginError(
            f"the {role} {name} gave no answer in {limit_s:g} s. If it is slow and does not hang, allow more seconds "
            f"per image with the environment variable {VARIABLE}"
        ) from None
    except SimpickError:
        raise
    except _WrongAnswerError as error:
        raise PluginError(f"the {role} {name} gave a wrong answer: {error}") from None
    except Exception as error:
        raise PluginError(f"the {role} {name} failed: {type(error).__name__}: {error}") from error
