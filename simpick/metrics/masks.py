"""Overlaps of detected and true masks, and what they count for: hits, misses, merges and splits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

MIN_VISIBLE_FRACTION = 0.3
"""Instances of which less is visible need not be found; detections of them count neither for nor against."""
FALSE, IGNORED = -1, -2
"""Instead of an instance's number: a detection of nothing, and one of what need not be found."""


@dataclass(frozen=True, eq=False)
class MaskOverlaps:
    """How the detections of one image overlap its true masks."""

    scores: Float[np.ndarray, "detections"]
    iou: Float[np.ndarray, "detections instances"]
    """Intersection over union."""
    covered: Float[np.ndarray, "detections instances"]
    """Intersection over the instance's area."""
    inside: Float[np.ndarray, "detections instances"]
    """Intersection over the detection's area."""
    visible_fractions: Float[np.ndarray, "instances"]
    """Share of each instance's silhouette that nothing hides."""

    @property
    def is_counted(self) -> Bool[np.ndarray, "instances"]:
        """Return which instances must be found."""
        return self.visible_fractions >= MIN_VISIBLE_FRACTION

    def above(self, score: float) -> MaskOverlaps:
        """Return the overlaps of the detections with at least this score."""
        kept = self.scores >= score
        return MaskOverlaps(
            self.scores[kept], self.iou[kept], self.covered[kept], self.inside[kept], self.visible_fractions
        )


def mask_overlaps(
    masks: Bool[np.ndarray, "detections height width"],
    scores: Float[np.ndarray, "detections"],
    truths: Bool[np.ndarray, "instances height width"],
    visible_fractions: Float[np.ndarray, "instances"],
) -> MaskOverlaps:
    """Return the overlaps of all detected masks with all true ones."""
    pixels = masks.shape[1] * masks.shape[2]
    found, true = (m.reshape(len(m), pixels).astype(np.float32) for m in (masks, truths))
    common = found @ true.T
    area, true_area = found.sum(axis=1)[:, None], true.sum(axis=1)[None]
    return MaskOverlaps(
        scores,
        common / np.maximum(area + true_area - common, 1),
        common / np.maximum(true_area, 1),
        common / np.maximum(area, 1),
        visible_fractions,
    )


def match_masks(overlaps: MaskOverlaps, threshold: float) -> Int[np.ndarray, "detections"]:
    """Return for each detection its instance, `FALSE` or `IGNORED`.

    As in COCO's evaluation: the detections, best score first, each take the free instance of the largest IoU, if that
    is at least `threshold`. A detection that takes none and lies mostly within instances that need not be found is
    ignored.
    """
    matches = np.full(len(overlaps.scores), FALSE)
    counted = overlaps.is_counted
    free = counted.copy()
    for k in np.argsort(-overlaps.scores, kind="stable"):
        iou = np.where(free, overlaps.iou[k], 0.0)
        best = int(iou.argmax()) if len(iou) else FALSE
        if best >= 0 and iou[best] >= threshold:
            matches[k] = best
            free[best] = False
        elif overlaps.inside[k][~counted].sum() >= 0.5:
            matches[k] = IGNORED
    return matches


def merged_count(overlaps: MaskOverlaps) -> int:
    """Return the number of detections that cover most of two or more instances."""
    return int(((overlaps.covered[:, overlaps.is_counted] > 0.5).sum(axis=1) > 1).sum())


def split_count(overlaps: MaskOverlaps) -> int:
    """Return the number of instances of which two or more detections, mostly inside, cover a tenth or more each."""
    pieces = (overlaps.inside > 0.5) & (overlaps.covered > 0.1)
    return int((pieces[:, overlaps.is_counted].sum(axis=0) > 1).sum())
