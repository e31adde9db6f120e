"""Boxes in images: ``xyxy`` in pixels, right and bottom edges exclusive (see `simpick.geometry`)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def box_of_mask(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "4"]:
    """Return the box around the pixels of a mask; four zeros for an empty mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return np.zeros(4)
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)


def window_of_mask(mask: Bool[np.ndarray, "height width"], margin_px: int) -> tuple[slice, slice]:
    """Return the rows and columns of the box around a mask, wider by a margin as far as the image reaches."""
    x1, y1, x2, y2 = box_of_mask(mask).astype(int)
    return slice(max(y1 - margin_px, 0), y2 + margin_px), slice(max(x1 - margin_px, 0), x2 + margin_px)


def rotated_boxes(
    masks: Bool[np.ndarray, "n size size"], angles_rad: Float[np.ndarray, "n turns"]
) -> Float[np.ndarray, "n turns 4"]:
    """Return the boxes, in pixels, of masks after rotating the square images clockwise about their centres.

    Only the corners of each row's first and last pixels are rotated: the extreme points of a mask are among them. The
    box of an empty mask is not finite.
    """
    size = masks.shape[-1]
    rows = np.arange(size)
    first, last = masks.argmax(axis=2), size - masks[:, :, ::-1].argmax(axis=2)  # (n, size)
    x = np.stack([first, first, last, last], axis=-1) - size / 2
    y = np.broadcast_to(np.stack([rows, rows + 1, rows, rows + 1], axis=-1) - size / 2, x.shape)
    empty = np.asarray(~masks.any(axis=2))[..., None]
    cosine, sine = (f(angles_rad).T[:, :, None, None] for f in (np.cos, np.sin))  # (turns, n, 1, 1)
    rotated = np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)  # (turns, n, size, corners, 2)
    low = np.where(empty[..., None], np.inf, rotated).min(axis=(2, 3))
    high = np.where(empty[..., None], -np.inf, rotated).max(axis=(2, 3))
    return np.swapaxes(np.concatenate([low, high], axis=-1) + size / 2, 0, 1)
