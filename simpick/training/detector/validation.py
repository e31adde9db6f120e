"""How well the detector segments held-out random bins while it trains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from simpick.estimators.detector.network import InstanceNetwork
from simpick.estimators.detector.scores import MaskScore
from simpick.estimators.detector.segmenter import InstanceSegmenter, SegmentedImage
from simpick.metrics.mask_scores import MaskScores
from simpick.metrics.masks import IGNORED, MaskOverlaps, mask_overlaps, match_masks
from simpick.training.detector.bin_data import BinImage
from simpick.training.detector.bin_files import read_view


class DetectorValidation:
    """One view of each held-out bin."""

    def __init__(self, files: Sequence[Path]) -> None:
        self._images = [read_view(file, 0) for file in files]

    def measure(self, network: InstanceNetwork) -> tuple[dict[str, float], MaskScore]:
        """Return the figures of a network's masks, and the score that was fitted to them and used for them."""
        segmenter = InstanceSegmenter(network)
        segmented = [segmenter.segment(image.rgb) for image in self._images]
        found = [compare_with_truth(s, image) for s, image in zip(segmented, self._images, strict=True)]
        features = np.concatenate([s.features for s in segmented])
        matches = np.concatenate([match_masks(o, 0.5) for o in found])
        score = MaskScore.fit(features[matches != IGNORED], (matches >= 0)[matches != IGNORED])
        rescored = [replace(o, scores=score(s.features)) for o, s in zip(found, segmented, strict=True)]
        figures = MaskScores(rescored).figures()
        return {name: round(value, 4) for name, value in asdict(figures).items()}, score


def compare_with_truth(found: SegmentedImage, image: BinImage) -> MaskOverlaps:
    """Return how the masks that were found overlap the true ones."""
    assert image.fractions is not None
    seen = np.unique(image.ids[image.ids > 0]).astype(int)
    shape = image.ids.shape
    return mask_overlaps(
        np.array(found.masks, bool).reshape(-1, *shape),
        found.scores,
        np.array([image.ids == k for k in seen], bool).reshape(-1, *shape),
        image.fractions[seen - 1].astype(float),
    )
