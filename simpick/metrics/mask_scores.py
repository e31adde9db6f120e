"""Figures of masks over images: average precision (COCO), panoptic quality, recall, merges and splits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from simpick.metrics.masks import FALSE, IGNORED, MaskOverlaps, match_masks, merged_count, split_count

IOU_THRESHOLDS = tuple(k / 100 for k in range(50, 100, 5))
"""Of COCO's average precision."""
CONFIDENT = 0.5
"""Least score of the detections that panoptic quality, merges and splits are counted over."""
_RECALLS = np.linspace(0, 1, 101)


@dataclass(frozen=True)
class MaskFigures:
    """Figures over images."""

    ap: float
    """Mean of the average precisions at `IOU_THRESHOLDS`."""
    ap50: float
    ap75: float
    pq: float
    """Panoptic quality of the confident detections (Kirillov et al. 2019)."""
    recall: float
    """Share of instances with a detection of IoU 0.5 or more, whatever its score."""
    iou: float
    """Mean over those."""
    merges: float
    """Confident detections that cover most of two or more instances, per instance."""
    splits: float
    """Instances with two or more confident detections inside, per instance."""


class MaskScores:
    """Matched detections of many images, from which figures of any weighting of the images follow."""

    def __init__(self, images: Sequence[MaskOverlaps]) -> None:
        self._images = list(images)
        self._counted = np.array([image.is_counted.sum() for image in images], float)

    def figures(self, weights: Float[np.ndarray, "images"] | None = None) -> MaskFigures:
        """Return the figures; `weights` says how often each image counts, once by default. NaN without instances."""
        w = np.ones(len(self._images)) if weights is None else weights
        total = float(w @ self._counted)
        if not total:
            return MaskFigures(*[float("nan")] * 8)
        precisions = [self._average_precision(k, w) for k in range(len(IOU_THRESHOLDS))]
        found, iou, true, quality, false, merges, splits = w @ self._sums
        return MaskFigures(
            ap=float(np.mean(precisions)),
            ap50=precisions[0],
            ap75=precisions[5],
            pq=float(quality / max(true + (false + total - true) / 2, 1e-9)),
            recall=float(found / total),
            iou=float(iou / max(found, 1e-9)),
            merges=float(merges / total),
            splits=float(splits / total),
        )

    @cached_property
    def _ranked(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Return for each threshold the detections, best first: their image, and whether they are right."""
        ranked = []
        for threshold in IOU_THRESHOLDS:
            matches = [match_masks(image, threshold) for image in self._images]
            scores = np.concatenate([i.scores[m != IGNORED] for i, m in zip(self._images, matches, strict=True)])
            hits = np.concatenate([(m >= 0)[m != IGNORED] for m in matches])
            image = np.repeat(np.arange(len(matches)), [int((m != IGNORED).sum()) for m in matches])
            order = np.argsort(-scores, kind="stable")
            ranked.append((image[order], hits[order]))
        return ranked

    def _average_precision(self, threshold: int, weights: Float[np.ndarray, "images"]) -> float:
        image, hits = self._ranked[threshold]
        found = np.cumsum(weights[image] * hits)
        if not len(found):
            return 0.0
        precision = found / np.maximum(np.cumsum(weights[image]), 1e-9)
        precision = np.maximum.accumulate(precision[::-1])[::-1]
        at = np.searchsorted(found / (weights @ self._counted), _RECALLS - 1e-9)
        return float(np.append(precision, 0.0)[at].mean())

    @cached_property
    def _sums(self) -> Float[np.ndarray, "images 7"]:
        """Return what each image adds to the figures beside average precision."""
        rows = []
        for image in self._images:
            matches = match_masks(image, 0.5)
            hit = np.flatnonzero(matches >= 0)
            confident = image.above(CONFIDENT)
            sure = match_masks(confident, 0.5)
            true = np.flatnonzero(sure >= 0)
            rows.append(
                [
                    len(hit),
                    image.iou[hit, matches[hit]].sum(),
                    len(true),
                    confident.iou[true, sure[true]].sum(),
                    (sure == FALSE).sum(),
                    merged_count(confident),
                    split_count(confident),
                ]
            )
        return np.array(rows, float).reshape(-1, 7)
