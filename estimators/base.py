"""The two protocols that perception is made of; third parties add theirs as ``simpick.estimators`` entry points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from simpick.assets.part import Part
from simpick.records import CameraFrame, Detection, PoseEstimate


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
