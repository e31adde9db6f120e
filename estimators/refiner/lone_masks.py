"""Which detections lie alone: nothing else that was detected is near them, so they can only rest on the floor."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool

from simpick.geometry import box_of_mask

_MARGIN = 0.15
"""Distance to another mask below which a part may lean on it, over the longer side of its mask's box."""


def are_alone(
    masks: Sequence[Bool[np.ndarray, "height width"]], all_masks: Sequence[Bool[np.ndarray, "height width"]]
) -> Bool[np.ndarray, "masks"]:
    """Return for each mask whether it is far from all others; `all_masks` holds it, too."""
    covered = np.sum(all_masks, axis=0, dtype=np.int32)
    return np.array([not _near(mask, covered - mask > 0) for mask in masks], bool)


def _near(mask: Bool[np.ndarray, "height width"], others: Bool[np.ndarray, "height width"]) -> bool:
    left, top, right, bottom = np.rint(box_of_mask(mask)).astype(int).tolist()
    reach = max(1, round(_MARGIN * max(right - left, bottom - top)))
    window = slice(max(0, top - reach), bottom + reach), slice(max(0, left - reach), right + reach)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    return bool((cv2.dilate(mask[window].astype(np.uint8), disc).astype(bool) & others[window]).any())
