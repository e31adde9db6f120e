"""`CloserLook`: the target's pose, refined from its estimate in a second image from nearby."""

from __future__ import annotations

import time
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float

from simpick.assets.part import Part
from simpick.estimators.base import Detector, PoseRefiner
from simpick.estimators.boundary import onboard_parts, validated_detections, validated_refinements
from simpick.geometry import invert
from simpick.geometry.transforms import transform_points
from simpick.records import CameraFrame, PoseEstimate, PoseHypothesis

_LEAST_OVERLAP = 0.05
"""A detection that shares less than this with the projected estimate (intersection over union) is another part."""


class CloserLook:
    """Finds the target in an image of the wrist camera and refines its pose from the first estimate."""

    def __init__(self, refiner: PoseRefiner, detector: Detector, parts: Sequence[Part]) -> None:
        """Onboard the parts, which may render templates."""
        self._refiner, self._detector = refiner, detector
        self._parts = {part.name: part for part in parts}
        onboard_parts([refiner], parts)

    def refined(
        self, frame: CameraFrame, part_name: str, T_world_part: Float[np.ndarray, "4 4"]
    ) -> PoseEstimate | None:
        """Return the refined pose in this frame's camera; None where the target is not seen or cannot be refined.

        The target is the detection whose mask overlaps the projected estimate most. Of the poses that look alike by
        the part's symmetries, the one turned least against the estimate is taken, so that the grasp stays the same.
        """
        start = time.perf_counter()
        part = self._parts[part_name]
        T_camera_part = invert(frame.T_world_camera) @ T_world_part
        expected = silhouette(frame, part, T_camera_part)
        seen = [
            (_overlap(d.mask, expected), d)
            for d in validated_detections(self._detector, frame, [part])
            if d.mask is not None
        ]
        overlap, detection = max(seen, key=lambda pair: pair[0], default=(0.0, None))
        if detection is None or overlap < _LEAST_OVERLAP:
            return None
        start_pose = PoseHypothesis(T_camera_part, detection.score)
        (refined,) = validated_refinements(self._refiner, frame, [detection], [(start_pose,)])
        if not refined:
            return None
        T_refined = part.symmetries.closest_equivalent(refined[0].T_camera_part, T_camera_part)
        elapsed_s = time.perf_counter() - start
        return PoseEstimate(part_name, T_refined, refined[0].score, "closer_look", elapsed_s, refined, detection)


def silhouette(frame: CameraFrame, part: Part, T_camera_part: Float[np.ndarray, "4 4"]) -> Bool[np.ndarray, "h w"]:
    """Return the convex hull of the part's projection; empty where the part reaches behind the camera."""
    image = np.zeros(frame.rgb.shape[:2], np.uint8)
    points = transform_points(T_camera_part, np.asarray(part.mesh.convex_hull.vertices, float))
    if points[:, 2].min() > 1e-3:
        pixels = frame.camera.project(points)
        corners = np.clip(np.rint(pixels), -10_000, 10_000).astype(np.int32)
        cv2.fillConvexPoly(image, cv2.convexHull(corners), 1)
    return image.astype(bool)


def _overlap(mask: Bool[np.ndarray, "h w"], expected: Bool[np.ndarray, "h w"]) -> float:
    union = np.count_nonzero(mask | expected)
    return np.count_nonzero(mask & expected) / union if union else 0.0
