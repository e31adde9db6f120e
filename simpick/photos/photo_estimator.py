"""`PhotoEstimator`: detection, pose estimation and checks of photographs, for parts that are onboarded once."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Float32

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.errors import ConfigError
from simpick.estimators.base import Detector
from simpick.estimators.boundary import onboard_parts, validated_detections, validated_estimates
from simpick.estimators.detections import TRIED
from simpick.estimators.registry import EstimatorName, find_estimator, load_estimator
from simpick.photos.box_masks import with_masks
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.photos.calibration import Undistortion
from simpick.photos.pose_checks import PoseChecks, check_pose
from simpick.records import CameraFrame, Detection
from simpick.rendering.posed_depth import PosedDepthRenderer

"""Detections that are tried per pose that is asked for."""
_DOUBTFUL = 0.5
"""Without a pose of this probability, a part may not be in the image: so it was for 83 % of 60 parts that were not, and
12 % of 24 that were (`docs/detector.md`)."""
_Scored = TypeVar("_Scored", Detection, CadPoseEstimate)


@dataclass(frozen=True, eq=False)
class PhotoPoses:
    """What was found in one image."""

    frame: CameraFrame
    """The undistorted image with its pinhole camera."""
    detections: tuple[Detection, ...]
    """In the undistorted image."""
    estimates: tuple[CadPoseEstimate, ...]
    """The most certain first."""
    timings_s: dict[str, float]
    """Wall-clock seconds of ``detect`` and ``estimate``."""


class PhotoEstimator(Closing):
    """Finds parts in photographs. A context manager; `close` frees OpenGL contexts."""

    def __init__(self, parts: Sequence[Part], mode: str = "refined") -> None:
        """Load the estimator called `mode` and onboard the parts.

        Raises:
            ConfigError: there are no parts, or two have the same name.
            UnknownNameError: no estimator has this name.
        """
        self.parts = {part.name: part for part in parts}
        if not parts or len(self.parts) != len(parts):
            raise ConfigError(f"parts must be one or more with different names, got {[part.name for part in parts]}")
        self.estimator = load_estimator(mode)
        self.gives_probabilities = find_estimator(EstimatorName.parse(mode).name).gives_probabilities
        """Whether scores are probabilities that a pose is good enough to pick by."""
        self._depth = PosedDepthRenderer()
        self._onboarded_detectors: set[int] = set()
        onboard_parts([self.estimator], parts)

    def estimate(
        self,
        rgb: np.ndarray,
        camera: Undistortion,
        detections: Detector | Sequence[Detection],
        *,
        count: int | None = None,
    ) -> PhotoPoses:
        """Return the poses of parts in an image: of what a detector finds, or of detections in the original image.

        Detections without a mask get one from their box (`simpick.photos.box_masks`). `count` limits the estimates of
        each part to the most certain among those of the 4 `count` most certain detections.
        """
        start = time.perf_counter()
        frame = camera.frame(rgb)
        if isinstance(detections, Detector):
            if id(detections) not in self._onboarded_detectors:
                onboard_parts([detections], list(self.parts.values()))
            self._onboarded_detectors.add(id(detections))
            start = time.perf_counter()
            found = validated_detections(detections, frame, list(self.parts.values()))
        else:
            moved = [
                replace(d, box_xyxy_px=camera.box(d.box_xyxy_px), mask=None if d.mask is None else camera.mask(d.mask))
                for d in detections
            ]
            found = with_masks(moved, frame)
        if count is not None:
            found = _best(found, TRIED * count)
        detect_s = time.perf_counter() - start
        start = time.perf_counter()
        answers = validated_estimates(self.estimator, [frame], [found])[0]
        timings_s = {"detect": detect_s, "estimate": time.perf_counter() - start}
        kept = [CadPoseEstimate.of(estimate, self.parts[estimate.part]) for estimate in answers]
        kept = _best(kept, len(kept) if count is None else count)
        return PhotoPoses(frame, tuple(found), tuple(kept), timings_s)

    def depth(
        self, part: str, T_camera_part: Float[np.ndarray, "4 4"], frame: CameraFrame
    ) -> Float32[np.ndarray, "height width"]:
        """Return the depth image of a part alone in metres; 0 beside it."""
        return self._depth.render(self.parts[part], T_camera_part[None], frame.camera)[0]

    def checks(self, poses: PhotoPoses) -> list[PoseChecks]:
        """Return the checks of each estimate."""
        return [
            check_pose(e, self.parts[e.part], poses.frame, self.depth(e.part, e.T_camera_part, poses.frame) > 0)
            for e in poses.estimates
        ]

    def doubts(self, poses: PhotoPoses) -> list[str]:
        """Return a sentence for each part of which no pose is probable, or of which there is none beside others'."""
        sentences = []
        for name in self.parts:
            best = max((estimate.score for estimate in poses.estimates if estimate.part == name), default=None)
            if best is None and poses.estimates:
                sentences.append(f"{name}: not found in this image")
            elif best is not None and self.gives_probabilities and best < _DOUBTFUL:
                sentences.append(
                    f"{name}: the most probable pose has a probability of {best:.2f} only; the part may not be in the "
                    "image, or its CAD file may have another size (simpick parts show)"
                )
        return sentences

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._depth.close()
        if isinstance(self.estimator, Closing):
            self.estimator.close()


def _best(items: Sequence[_Scored], count: int) -> list[_Scored]:
    """Return the `count` items of each part with the highest scores, the highest first."""
    seen: Counter[str] = Counter()
    kept = []
    for item in sorted(items, key=lambda item: -item.score):
        seen[item.part] += 1
        if seen[item.part] <= count:
            kept.append(item)
    return kept
