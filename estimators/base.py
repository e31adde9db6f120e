"""Protocols of perception: detectors, pose estimators and refiners. `registry` says how other packages add theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool

from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis

if TYPE_CHECKING:
    # Loads trimesh, which listing the names of estimators must not.
    from simpick.assets.part import Part


@runtime_checkable
class Detector(Protocol):
    """Finds part instances in an image."""

    def detect(self, frame: CameraFrame, parts: Sequence[Part]) -> list[Detection]:
        """Return detections of these parts, best first."""
        ...


@runtime_checkable
class OnboardingDetector(Detector, Protocol):
    """A `Detector` that prepares for parts, so that the first image does not wait for it."""

    def onboard(self, part: Part) -> None:
        """Prepare for a part; cached on disk by `Part.content_hash`."""
        ...


@runtime_checkable
class ForegroundDetector(Detector, Protocol):
    """A `Detector` that also knows which pixels show parts, detected or not: the rest is the empty bin.

    What no estimated pose explains of them is an obstacle to the grasp planner.
    """

    def foreground(self, frame: CameraFrame) -> Bool[np.ndarray, "height width"]:
        """Return the pixels that show parts."""
        ...


@runtime_checkable
class SizedDetector(Detector, Protocol):
    """A `Detector` that states how much of a part it must see, which explains why it found none."""

    @property
    def min_visible_px(self) -> int:
        """Return the fewest pixels of a part that are detected."""
        ...


@runtime_checkable
class PoseEstimator(Protocol):
    """Turns detections into 6D poses."""

    def onboard(self, part: Part) -> None:
        """Prepare for a part (templates, descriptors); cached on disk by `Part.content_hash`."""
        ...

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate per detection that the estimator can answer, in the detections' order.

        Others, such as those with an empty mask, get none; `PoseEstimate.detection` says which detection is meant.
        """
        ...


@runtime_checkable
class BatchPoseEstimator(PoseEstimator, Protocol):
    """A `PoseEstimator` that estimates several frames in one batch, faster than one by one."""

    def estimate_batch(
        self, frames: Sequence[CameraFrame], detections: Sequence[Sequence[Detection]]
    ) -> list[list[PoseEstimate]]:
        """Return the estimates for the detections of each frame, as `estimate` does."""
        ...


@runtime_checkable
class PoseRefiner(Protocol):
    """Improves approximate poses."""

    def onboard(self, part: Part) -> None:
        """Prepare for a part; cached on disk by `Part.content_hash`."""
        ...

    def refine(
        self,
        frame: CameraFrame,
        detections: Sequence[Detection],
        hypotheses: Sequence[Sequence[PoseHypothesis]],
    ) -> list[tuple[PoseHypothesis, ...]]:
        """Return the refined hypotheses of each detection in this frame's camera, best first.

        `hypotheses` are those to start from, per detection and in the same camera. A detection that cannot be refined
        gets none.
        """
        ...
