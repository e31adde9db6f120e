"""Perception: a detector and a pose estimator, and their result for one frame."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from simpick.assets.part import Part
from simpick.estimators.base import Detector, ForegroundDetector, PoseEstimator, SizedDetector
from simpick.estimators.boundary import (
    onboard_parts,
    validated_detections,
    validated_estimates,
    validated_foreground,
)
from simpick.estimators.oracle import OracleEstimator
from simpick.policies.resting_estimates import resting_estimates
from simpick.records import CameraFrame, Detection, PoseEstimate


@dataclass(frozen=True, eq=False)
class Percept:
    """Detections and estimates of one frame."""

    detections: tuple[Detection, ...]
    estimates: tuple[PoseEstimate, ...]
    timings_s: dict[str, float]
    """Wall-clock seconds of ``detect`` and ``estimate``."""
    foreground: Bool[np.ndarray, "height width"] | None = None
    """Pixels that show parts, detected or not; None if the detector does not know."""
    needed_px: int | None = None
    """Fewest visible pixels of a part that are detected; None if the detector does not state it."""


@dataclass(frozen=True)
class Perception:
    """A detector followed by a pose estimator: the part of a policy that simpick compares.

    Estimates from images are moved along their lines of sight until the parts rest in the bin (`resting_estimates`);
    the oracle's poses, and their known errors, stay as they are.
    """

    name: str
    detector: Detector
    estimator: PoseEstimator
    foreground: ForegroundDetector | None = None
    """What reports the pixels that show parts, if the detector does not."""

    def onboard(self, parts: Sequence[Part]) -> None:
        """Prepare the estimator for these parts, and the detector if it needs that."""
        onboard_parts([self.estimator, self.detector], parts)

    def perceive(self, frame: CameraFrame, parts: Sequence[Part]) -> Percept:
        """Detect these parts in the frame and estimate their poses, all in one batch."""
        return perceive_together([self], [frame], parts)[0]


def perceive_together(
    perceptions: Sequence[Perception], frames: Sequence[CameraFrame], parts: Sequence[Part]
) -> list[Percept]:
    """Return each perception's result for its own frame; those that share an estimator run it once, for all.

    Each bin has a perception of its own, for detectors and oracles know their bin; estimators that work from images
    alone are shared. The time of a batch is split evenly among its frames.
    """
    start = time.perf_counter()
    detections, foregrounds, detect_s = [], [], []
    for perception, frame in zip(perceptions, frames, strict=True):
        detections.append(validated_detections(perception.detector, frame, parts))
        foregrounds.append(_foreground(perception, frame))
        detect_s.append(time.perf_counter() - start)
        start = time.perf_counter()
    sharing: dict[int, list[int]] = {}
    for k, perception in enumerate(perceptions):
        sharing.setdefault(id(perception.estimator), []).append(k)
    percepts: dict[int, Percept] = {}
    for rows in sharing.values():
        start = time.perf_counter()
        estimator = perceptions[rows[0]].estimator
        found = validated_estimates(estimator, [frames[k] for k in rows], [detections[k] for k in rows])
        estimate_s = (time.perf_counter() - start) / len(rows)
        for k, estimates in zip(rows, found, strict=True):
            start = time.perf_counter()
            if not isinstance(estimator, OracleEstimator):
                estimates = resting_estimates(estimates, parts, frames[k].T_world_camera)
            timings_s = {"detect": detect_s[k], "estimate": estimate_s + time.perf_counter() - start}
            percepts[k] = Percept(
                tuple(detections[k]), tuple(estimates), timings_s, foregrounds[k], _needed_px(perceptions[k].detector)
            )
    return [percepts[k] for k in range(len(frames))]


def _needed_px(detector: Detector) -> int | None:
    return detector.min_visible_px if isinstance(detector, SizedDetector) else None


def _foreground(perception: Perception, frame: CameraFrame) -> Bool[np.ndarray, "height width"] | None:
    found = validated_foreground(perception.detector, frame)
    if found is None and perception.foreground is not None:
        return validated_foreground(perception.foreground, frame)
    return found
