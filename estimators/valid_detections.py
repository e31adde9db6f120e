"""The detections that image-based estimators can answer, with the pixels and boxes that they work from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.detector.boxed_instances import with_instances
from simpick.estimators.mask_outlines import on_image_edges
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection


@dataclass(frozen=True, eq=False)
class ValidDetection:
    """A detection with enough pixels to estimate a pose from."""

    detection: Detection
    mask: Bool[np.ndarray, "height width"]
    """The detection's mask; where it has none, the instance that fills its box, or the box within the image."""
    box_xyxy_px: Float[np.ndarray, "4"]
    """Around the mask."""


def valid_detections(detections: Sequence[Detection], frame: CameraFrame, min_mask_px: int) -> list[ValidDetection]:
    """Return the detections with enough pixels; a single line of pixels has no shape and is left out.

    Detections without a mask get one where the learned segmentation has an instance that fills their box.

    Raises:
        ConfigError: the image is not of 8-bit RGB, or a mask has another size than the image.
    """
    if frame.rgb.dtype != np.uint8:
        raise ConfigError(f"an image must have 8-bit channels (uint8), got {frame.rgb.dtype}")
    masks = [detection_mask(detection, frame) for detection in with_instances(frame, detections)]
    return [
        ValidDetection(detection, mask, box_of_mask(mask))
        for detection, mask in zip(detections, masks, strict=True)
        if has_shape(mask, min_mask_px)
    ]


def has_shape(mask: Bool[np.ndarray, "height width"], min_px: int) -> bool:
    """Return whether a mask has this many pixels or more, and they are not a single line."""
    if np.count_nonzero(mask) < min_px:
        return False
    box = box_of_mask(mask)
    return bool((box[2:] - box[:2] >= 2).all())


def detection_mask(detection: Detection, frame: CameraFrame) -> Bool[np.ndarray, "height width"]:
    """Return a detection's mask, or its box where it has none; empty if the box lies outside the image.

    Every image-based estimator works with these masks, whose outlines are moved to the image's edges where the image
    contradicts them.

    Raises:
        ConfigError: the mask has another size than the image.
    """
    height, width = frame.rgb.shape[:2]
    if detection.mask is None:
        mask = np.zeros((height, width), bool)
        box = np.asarray(detection.box_xyxy_px, float)
        if np.isfinite(box).all():
            x1, y1, x2, y2 = np.clip(np.rint(box), 0, [width, height, width, height]).astype(int)
            mask[y1:y2, x1:x2] = True
        return mask
    if detection.mask.shape != (height, width):
        raise ConfigError(
            f"mask must have the image's size {width} x {height} px, "
            f"got {detection.mask.shape[1]} x {detection.mask.shape[0]}"
        )
    return on_image_edges(frame.rgb, detection.mask)


def check_onboarded(detections: Iterable[Detection], onboarded: Iterable[str]) -> None:
    """Raise UnknownNameError if a detection's part is not among those that were onboarded."""
    known = set(onboarded)
    for detection in detections:
        if detection.part not in known:
            raise UnknownNameError("onboarded part", detection.part, known, "Call onboard(part) first.")
