"""Masks of objects in boxes that a person drew: the instance that fills the box, or GrabCut (Rother et al., 2004)."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from simpick.estimators.detector.boxed_instances import with_instances
from simpick.records import CameraFrame, Detection

_MARGIN = 0.5
"""Surroundings that teach GrabCut the background, as a share of the box's longer side."""
_WORK_PX = 240
"""Longer side of the window in which GrabCut works."""
_ITERATIONS = 5
_CORE = 0.2
"""Share of the box's sides, about its centre, that is taken to show the object; without it GrabCut often finds none."""
_LEAST_SHARE = 0.25
"""A mask that fills less of its box is not taken for the object."""


def with_masks(detections: list[Detection], frame: CameraFrame) -> list[Detection]:
    """Return the detections, those without a mask with one from their box; unchanged where both ways fail."""
    return [
        d if d.mask is not None else replace(d, mask=mask_in_box(frame.rgb, d.box_xyxy_px))
        for d in with_instances(frame, detections)
    ]


def mask_in_box(
    rgb: UInt8[np.ndarray, "height width 3"], box_xyxy_px: Float[np.ndarray, "4"]
) -> Bool[np.ndarray, "height width"] | None:
    """Return the object inside a box by GrabCut; None if the box is outside the image or no object is found."""
    height, width = rgb.shape[:2]
    x1, y1, x2, y2 = np.clip(np.rint(box_xyxy_px), 0, [width, height, width, height]).astype(int).tolist()
    if x2 - x1 < 4 or y2 - y1 < 4:
        return None
    margin = int(np.ceil(_MARGIN * max(x2 - x1, y2 - y1)))
    left, top = max(x1 - margin, 0), max(y1 - margin, 0)
    right, bottom = min(x2 + margin, width), min(y2 + margin, height)
    window = rgb[top:bottom, left:right]
    scale = min(1.0, _WORK_PX / max(window.shape[:2]))
    small = cv2.resize(window, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    labels = np.full(small.shape[:2], cv2.GC_BGD, np.uint8)
    rows = slice(round((y1 - top) * scale), round((y2 - top) * scale))
    columns = slice(round((x1 - left) * scale), round((x2 - left) * scale))
    labels[rows, columns] = cv2.GC_PR_FGD
    labels[_middle(rows), _middle(columns)] = cv2.GC_FGD
    if not (labels == cv2.GC_BGD).any():
        return None  # The box is the whole image: there is no background to learn from.
    cv2.setRNGSeed(0)
    cv2.grabCut(np.ascontiguousarray(small[..., ::-1]), labels, None, None, None, _ITERATIONS, cv2.GC_INIT_WITH_MASK)  # type: ignore[call-overload]
    found = ((labels == cv2.GC_FGD) | (labels == cv2.GC_PR_FGD)).astype(np.uint8)
    found = cv2.morphologyEx(found, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, pieces, statistics, _ = cv2.connectedComponentsWithStats(found)
    if count < 2:
        return None
    largest = 1 + int(statistics[1:, cv2.CC_STAT_AREA].argmax())
    if statistics[largest, cv2.CC_STAT_AREA] < _LEAST_SHARE * (rows.stop - rows.start) * (columns.stop - columns.start):
        return None
    mask = np.zeros((height, width), bool)
    size = (right - left, bottom - top)
    mask[top:bottom, left:right] = cv2.resize(255 * (pieces == largest).astype(np.uint8), size) > 127
    return mask


def _middle(side: slice) -> slice:
    """Return the middle of a side of the box, at least one pixel of it."""
    centre, half = (side.start + side.stop) // 2, max(1, round(_CORE * (side.stop - side.start) / 2))
    return slice(centre - half, centre + half)
