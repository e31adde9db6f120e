"""Outlines at the image's own edges: each mask gives up a narrow band, which a watershed of the image shares out."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from scipy.ndimage import distance_transform_edt

from simpick.geometry import window_of_mask

# OpenCV's watershed leaves a line of undecided pixels between regions, which is thinner on an enlarged image.
_SCALE = 2
_LEAST_KEPT = 0.2


def sharpen_outlines(
    rgb: UInt8[np.ndarray, "height width 3"], masks: Sequence[Bool[np.ndarray, "height width"]], *, band_px: int = 2
) -> list[Bool[np.ndarray, "height width"]]:
    """Return masks, disjoint as the given ones, with outlines that follow the image within `band_px` on each side."""
    if not masks:
        return []
    band = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * band_px + 1, 2 * band_px + 1))
    markers = np.zeros(rgb.shape[:2], np.int32)
    for k, mask in enumerate(masks, 1):
        window = window_of_mask(mask, band_px)
        whole = mask[window]
        inner = cv2.erode(whole.astype(np.uint8), band) > 0
        # What is thin keeps all of itself, as far as its neighbours leave it.
        markers[window][inner if inner.sum() >= _LEAST_KEPT * whole.sum() else whole] = k
    background = cv2.erode((~np.any(masks, axis=0)).astype(np.uint8), band) > 0
    markers[background] = len(masks) + 1
    size = (_SCALE * rgb.shape[1], _SCALE * rgb.shape[0])
    enlarged = cv2.resize(rgb, size, interpolation=cv2.INTER_CUBIC)
    markers = markers.repeat(_SCALE, axis=0).repeat(_SCALE, axis=1)
    labels = cv2.watershed(enlarged, markers)[_SCALE // 2 :: _SCALE, _SCALE // 2 :: _SCALE]
    undecided = labels < 1
    if undecided.any() and not undecided.all():
        nearest = distance_transform_edt(undecided, return_distances=False, return_indices=True)
        labels = labels[tuple(np.asarray(nearest))]
    return [labels == k for k in range(1, len(masks) + 1)]
