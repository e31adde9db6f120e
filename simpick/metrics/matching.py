"""Selection and matching of estimates and truths by BOP's rules for the localization task."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from simpick.errors import ConfigError


def top_estimates(scores: Float[np.ndarray, "e"], inst_count: int) -> Int[np.ndarray, "k"]:
    """Return the indices of the `inst_count` highest scores, highest first; ties go to the earlier.

    Raises:
        ConfigError: a score is not finite.
    """
    if not np.isfinite(scores).all():
        raise ConfigError(f"scores of estimates must be finite, got {scores.tolist()}; estimates are ranked by them")
    return np.argsort(-scores, kind="stable")[:inst_count]


def valid_truths(visible_fractions: Float[np.ndarray, "g"], inst_count: int) -> Int[np.ndarray, "k"]:
    """Return the indices of the `inst_count` most visible truths, ascending; ties go to the earlier."""
    return np.sort(np.argsort(-visible_fractions, kind="stable")[:inst_count])


def greedy_matches(errors: Float[np.ndarray, "e g"], thresholds: Float[np.ndarray, "k"]) -> Int[np.ndarray, "k e"]:
    """Return the index of the truth matched to each estimate at each threshold, or -1.

    Estimates choose in the order of the rows, highest score first: each takes the unmatched truth with the least error,
    if that error is *below* the threshold; ties go to the first. Each truth is matched once.
    """
    errors = np.where(np.isnan(errors), np.inf, errors)
    matches = np.full((len(thresholds), len(errors)), -1)
    if errors.shape[1] == 0:
        return matches
    taken = np.zeros((len(thresholds), errors.shape[1]), bool)
    rows = np.arange(len(thresholds))
    for e, error in enumerate(errors):
        free = np.where(taken, np.inf, error)
        best = free.argmin(1)
        hit = free[rows, best] < thresholds
        matches[hit, e] = best[hit]
        taken[rows[hit], best[hit]] = True
    return matches
