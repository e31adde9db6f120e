"""Perception: a detector and a pose estimator, and what they saw in one frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

from simpick.assets.part import Part
from simpick.estimators.base import Detector, PoseEstimator
from simpick.records import CameraFrame, Detection, PoseEstimate


@dataclass(frozen=True, eq=False)
class Percept:
    """What perception made of one frame."""

    detections: tuple[Detection, ...]
    estimates: tuple[PoseEstimate, ...]
    timings_s: dict[str, float]
    """Wall-clock seconds of ``detect`` and ``estimate``."""


@dataclass(frozen=True)
class Perception:
    """A detector followed by a pose estimator: the part of a policy that simpick compares."""

    name: str
    detector: Detector
    estimator: PoseEstimator

    def onboard(self, parts: Sequence[Part]) -> None:
        """Prepare the estimator for these parts."""
        for part in parts:
            self.estimator.onboard(part)

    def perceive(self, frame: CameraFrame, parts: Sequence[Part]) -> Percept:
        """Detect these parts in the frame and estimate their poses, all in one batch."""
        start = time.perf_counter()
        detections = self.detector.detect(frame, parts)
        detected = time.perf_counter()
        estimates = self.estimator.estimate(frame, detections)
        timings_s = {"detect": detected - start, "estimate": time.perf_counter() - detected}
        return Percept(tuple(detections), tuple(estimates), timings_s)
