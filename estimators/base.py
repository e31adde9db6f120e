"""The two protocols that perception is made of; third parties add theirs as ``simpick.estimators`` entry points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

if TYPE_CHECKING:
    # Loads trimesh, which the names of estimators must not.
    from simpick.assets.part import Part


@runtime_checkable
class Detector(Protocol):
    """Finds part instances in an image."""

    def detect(self, frame: CameraFrame, parts: Sequence[Part]) -> list[Detection]:
        """Return detections of these parts, best first."""
        ...


@runtime_checkable
class PoseEstimator(Protocol):
    """Turns detections into 6D poses."""

    def onboard(self, part: Part) -> None:
        """Prepare for a part (templates, descriptors); cached on disk by `Part.content_hash`."""
        ...

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate for each detection that the estimator can answer, in the detections' order.

        A detection it cannot answer (an empty mask, say) has no estimate; match by `PoseEstimate.detection`.
        """
        ...


@runtime_checkable
class BatchPoseEstimator(PoseEstimator, Protocol):
    """A `PoseEstimator` that answers the detections of several frames at once, for less than one by one."""

    def estimate_batch(
        self, frames: Sequence[CameraFrame], detections: Sequence[Sequence[Detection]]
    ) -> list[list[PoseEstimate]]:
        """Return for each frame what `estimate` returns for its detections."""
        ...


@runtime_checkable
class PoseRefiner(Protocol):
    """Improves poses that are roughly known."""

    def onboard(self, part: Part) -> None:
        """Prepare for a part; cached on disk by `Part.content_hash`."""
        ...

    def refine(
        self,
        frame: CameraFrame,
        detections: Sequence[Detection],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[tuple[PoseHypothesis, ...]]:
        """Return for each detection its refined hypotheses in this frame's camera, best first.

        `hypotheses` holds for each detection those to start from, in the same camera. A detection that cannot be
        refined gets none.
        """
        ...


def estimate_frames(
    estimator: PoseEstimator, frames: Sequence[CameraFrame], detections: Sequence[Sequence[Detection]]
) -> list[list[PoseEstimate]]:
    """Return the estimates for each frame's detections: in one batch where the estimator can, else frame by frame."""
    if isinstance(estimator, BatchPoseEstimator):
        return estimator.estimate_batch(frames, detections)
    return [estimator.estimate(frame, found) for frame, found in zip(frames, detections, strict=True)]
