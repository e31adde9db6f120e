"""Probabilities of masks: that one is a whole instance, and that two clusters are one.

Both are logistic regressions. The first is fitted on held-out bins by every validation of a training run and kept with
the weights; the second was fitted on bins of held-out random parts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.special import expit

from simpick.geometry import window_of_mask

_RING_PX = 7
# Merge: logit = a + b * logit of the mean affinity + c * gain in similarity.
_MERGE_A, _MERGE_B, _MERGE_C = 1.48, 1.72, 17.2
_RIDGE = 1e-3


@dataclass(frozen=True)
class MaskScore:
    """The probability that a mask overlaps an instance by an IoU of one half, from `Instances.features`."""

    intercept: float = -6.0
    weights: tuple[float, ...] = (4.0, -4.0, 4.0, 0.3)
    """One for each feature."""

    def __call__(self, features: Float[np.ndarray, "instances features"]) -> Float[np.ndarray, "instances"]:
        """Return the probability of each instance."""
        return expit(self.intercept + features @ np.array(self.weights))

    @staticmethod
    def fit(features: Float[np.ndarray, "instances features"], is_right: Bool[np.ndarray, "instances"]) -> MaskScore:
        """Return the logistic regression of these instances; the default where all or none are right."""
        if is_right.all() or not is_right.any():
            return MaskScore()
        mean, spread = features.mean(axis=0), features.std(axis=0) + 1e-6
        X = np.column_stack([np.ones(len(features)), (features - mean) / spread])
        y = is_right.astype(float)

        def loss(w: np.ndarray) -> float:
            return float((np.logaddexp(0, X @ w) - y * (X @ w)).mean() + _RIDGE * (w[1:] @ w[1:]))

        found = minimize(loss, np.zeros(X.shape[1])).x
        weights = found[1:] / spread
        return MaskScore(float(found[0] - weights @ mean), tuple(float(w) for w in weights))


def is_one_instance(affinity: float, gain: float) -> bool:
    """Return whether two neighbouring clusters are more probably one instance than two.

    `gain` says how much more similar to some part the two together are than each alone, weighted by their cells.
    """
    affinity = min(max(affinity, 1e-6), 1 - 1e-6)
    return _MERGE_A + _MERGE_B * math.log(affinity / (1 - affinity)) + _MERGE_C * gain > 0


def exposure(masks: Sequence[Bool[np.ndarray, "height width"]]) -> Float[np.ndarray, "instances"]:
    """Return the share of each mask's surroundings that no other mask covers: 1 where it lies apart."""
    covered = np.any(masks, axis=0) if masks else np.zeros((1, 1), bool)
    kernel = np.ones((_RING_PX, _RING_PX), np.uint8)
    shares = []
    for mask in masks:
        window = window_of_mask(mask, _RING_PX // 2)
        ring = (cv2.dilate(mask[window].astype(np.uint8), kernel) > 0) & ~mask[window]
        shares.append(1 - (ring & covered[window]).sum() / max(int(ring.sum()), 1))
    return np.array(shares, float)
