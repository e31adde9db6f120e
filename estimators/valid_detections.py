"""Which detections an image-based estimator can answer, with the pixels and the box that it goes by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from simpick.errors import ConfigError
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection


def valid_detections(
    detections: Sequence[Detection], frame: CameraFrame, min_mask_px: int
) -> list[tuple[Detection, Bool[np.ndarray, "height width"], Float[np.ndarray, "4"]]]:
    """Return the detections with enough pixels, each with its mask and the box around that.

    Where a detection has no mask, its whole box counts, as far as it lies in the image. A line of pixels has no shape
    and no crop, and is left out.

    Raises:
        ConfigError: the image is not of 8-bit RGB, or a mask has another size than the image.
    """
    if frame.rgb.dtype != np.uint8:
        raise ConfigError(f"an image must have 8-bit channels (uint8), got {frame.rgb.dtype}")
    found = []
    for detection in detections:
        mask = detection_mask(detection, frame)
        if np.count_nonzero(mask) >= min_mask_px:
            box = box_of_mask(mask)
            if (box[2:] - box[:2] >= 2).all():
                found.append((detection, mask, box))
    return found


def detection_mask(detection: Detection, frame: CameraFrame) -> Bool[np.ndarray, "height width"]:
    """Return a detection's mask, or its box where it has none; empty if it lies outside the image.

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
    return detection.mask
