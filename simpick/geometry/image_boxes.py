"""Boxes in images: ``xyxy`` in pixels, right and bottom edges exclusive (see `simpick.geometry`)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def box_of_mask(mask: Bool[np.ndarray, "height width"]) -> Float[np.ndarray, "4"]:
    """Return the box around the pixels of a mask; four zeros, a box without area, if it has none."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return np.zeros(4)
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1], float)
