"""The maps that a perfect network would return for an image of instance numbers."""

import numpy as np

from simpick.estimators.detector.affinities import OFFSETS, pair_windows


def ideal_maps(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the foreground and the affinities of cells with these instance numbers, 0 in the background."""
    affinities = np.zeros((len(OFFSETS), *ids.shape), np.float32)
    for k, offset in enumerate(OFFSETS):
        here, there = pair_windows(ids.shape[0], ids.shape[1], offset)
        affinities[k][here] = (ids[here] == ids[there]) & (ids[here] > 0)
    return (ids > 0).astype(np.float32), affinities
