"""Masks for detections that are boxes: the instance that fills the box, or what the first pose shows in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from simpick.assets.part import Part
from simpick.closing import Closing
from simpick.estimators.detector.boxed_instances import with_instances
from simpick.estimators.detector.outlines import sharpen_outlines
from simpick.records import CameraFrame, Detection, PoseEstimate
from simpick.rendering.posed_depth import PosedDepthRenderer


class BoxMasks(Closing):
    """Draws the estimated poses of one image together, each hiding what is behind it. A context manager."""

    def __init__(self) -> None:
        self._renderer = PosedDepthRenderer()

    def masked(
        self, frame: CameraFrame, estimates: Sequence[PoseEstimate], parts: Mapping[str, Part]
    ) -> list[Detection]:
        """Return the estimates' detections, each with a mask.

        Those that have one keep it. The others get that of the instance that fills their box (`with_instances`), or
        the pixels inside their box in which their part is in front of all other estimated parts, with outlines at the
        image's edges (`sharpen_outlines`). `parts` are by name; every estimate must have a detection.
        """
        given = [estimate.detection for estimate in estimates if estimate.detection is not None]
        detections = with_instances(frame, given)
        boxes = [k for k, detection in enumerate(detections) if detection.mask is None]
        if not boxes:
            return detections
        nearest_m = np.full((frame.camera.height, frame.camera.width), np.inf, np.float32)
        owner = np.full(nearest_m.shape, -1)
        for k, estimate in enumerate(estimates):
            (depth_m,) = self._renderer.render(parts[estimate.part], estimate.T_camera_part[None], frame.camera)
            in_front = (depth_m > 0) & (depth_m < nearest_m)
            nearest_m[in_front], owner[in_front] = depth_m[in_front], k
        for k in boxes:
            x1, y1, x2, y2 = np.rint(detections[k].box_xyxy_px).astype(int).clip(0)
            mask = np.zeros(owner.shape, bool)
            mask[y1:y2, x1:x2] = owner[y1:y2, x1:x2] == k
            if mask.any():
                (mask,) = sharpen_outlines(frame.rgb, [mask])
            detections[k] = replace(detections[k], mask=mask)
        return detections

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._renderer.close()
