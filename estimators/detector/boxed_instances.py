"""Masks for detections that are boxes: the instance of the learned segmentation that fills the box.

Where no instance does, a box stays a box: see `simpick.estimators.refiner.box_masks` for what the refiner makes of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from jaxtyping import Bool, Float, UInt8

from simpick.estimators.detector.checkpoints import load_detector_checkpoint, shipped_detector_checkpoint
from simpick.estimators.detector.segmenter import SMALLEST_PX, InstanceSegmenter
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection

_LEAST_OVERLAP = 0.8
"""Overlap (IoU) of a detection's box with that of an instance from which the instance is the detection's."""

Mask = Bool[np.ndarray, "height width"]


def with_instances(frame: CameraFrame, detections: Sequence[Detection]) -> list[Detection]:
    """Return the detections; those without a mask get that of the instance that fills their box best, if one does.

    Of the frame only the image is read.

    Raises:
        CheckpointError: a detection has no mask, and this installation has no weights of the detector.
        ConfigError: a detection has no mask, and the image is not of 8-bit RGB.
    """
    if all(detection.mask is not None for detection in detections) or min(frame.rgb.shape[:2]) < SMALLEST_PX:
        return list(detections)
    masks = _shared_segmentation().masks(frame.rgb)
    boxes = np.array([box_of_mask(mask) for mask in masks]).reshape(-1, 4)
    return [d if d.mask is not None else replace(d, mask=_filling(d.box_xyxy_px, boxes, masks)) for d in detections]


class _Segmentation:
    """The shipped segmenter and the instances of the last image, for which several estimators ask in a row."""

    def __init__(self) -> None:
        checkpoint = load_detector_checkpoint(shipped_detector_checkpoint())
        self._segmenter = InstanceSegmenter(checkpoint.network, checkpoint.score)
        self._seen: tuple[np.ndarray, list[Mask]] | None = None

    def masks(self, rgb: UInt8[np.ndarray, "height width 3"]) -> list[Mask]:
        """Return the masks of an image's instances."""
        if self._seen is None or not np.array_equal(self._seen[0], rgb):
            self._seen = rgb.copy(), self._segmenter.segment(rgb).masks
        return self._seen[1]


@cache
def _shared_segmentation() -> _Segmentation:
    return _Segmentation()


def _filling(
    box_xyxy_px: Float[np.ndarray, "4"], boxes_xyxy_px: Float[np.ndarray, "n 4"], masks: Sequence[Mask]
) -> Mask | None:
    """Return the mask whose box overlaps a box most; None if none does so by `_LEAST_OVERLAP`."""
    box = np.asarray(box_xyxy_px, float)
    if not len(masks) or not np.isfinite(box).all():
        return None
    low, high = np.maximum(box[:2], boxes_xyxy_px[:, :2]), np.minimum(box[2:], boxes_xyxy_px[:, 2:])
    both = (high - low).clip(0).prod(axis=1)
    areas = (boxes_xyxy_px[:, 2:] - boxes_xyxy_px[:, :2]).prod(axis=1) + (box[2:] - box[:2]).clip(0).prod()
    overlaps = both / (areas - both).clip(1e-9)
    best = int(overlaps.argmax())
    return masks[best] if overlaps[best] >= _LEAST_OVERLAP else None
