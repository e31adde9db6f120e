"""Superpixels: small regions around the innermost cells, which the predicted borders separate."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int32, Int64
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from simpick.estimators.detector.affinities import OFFSETS, pair_windows

_SHORT_CELLS = 4
_SMOOTHING_CELLS = 1.0
# Cells that are equally far inside still need an order: towards where more cells are far inside.
_PLATEAU_CELLS = 4.0
_PLATEAU_WEIGHT = 0.01
_LINKED = 0.5
_SIDES = ((0, 1), (1, 0))


def superpixels(
    foreground: Bool[np.ndarray, "h w"], affinities: Float32[np.ndarray, "offsets h w"]
) -> Int32[np.ndarray, "h w"]:
    """Return the number of each foreground cell's superpixel, from 1; 0 in the background.

    Each cell points to the neighbour that lies furthest inside of an instance, if that lies further inside than itself
    and is linked to it; what ends in the same cell is one superpixel.
    """
    height = np.where(foreground, interior(affinities), -1.0).astype(np.float32)
    target = _climb(height, foreground, affinities)
    while True:
        further = target[target]
        if (further == target).all():
            break
        target = further
    labels = np.where(foreground.ravel(), target, -1)
    numbers = np.unique(labels, return_inverse=True)[1].reshape(foreground.shape)
    return (numbers + (0 if (labels < 0).any() else 1)).astype(np.int32)


def interior(affinities: Float32[np.ndarray, "offsets h w"]) -> Float32[np.ndarray, "h w"]:
    """Return how far inside of an instance each cell lies, in [0, 1]: the mean of its short affinities, smoothed."""
    size = affinities.shape[1], affinities.shape[2]
    total, count = np.zeros(size, np.float32), 0
    for offset, affinity in zip(OFFSETS, affinities, strict=True):
        if max(map(abs, offset)) <= _SHORT_CELLS:
            first, second = pair_windows(*size, offset)
            total[first] += affinity[first]
            total[second] += affinity[first]
            count += 2
    mean = total / count
    return cv2.GaussianBlur(mean, (0, 0), _SMOOTHING_CELLS) + _PLATEAU_WEIGHT * cv2.GaussianBlur(
        mean, (0, 0), _PLATEAU_CELLS
    )


def _climb(
    height: Float32[np.ndarray, "h w"],
    foreground: Bool[np.ndarray, "h w"],
    affinities: Float32[np.ndarray, "offsets h w"],
) -> Int64[np.ndarray, "cells"]:
    """Return for each cell the number of the cell that it points to; its own if it is a peak."""
    size = height.shape[0], height.shape[1]
    cells = np.arange(height.size).reshape(size)
    target, best = cells.copy(), height.copy()
    level = []
    for offset in _SIDES:
        first, second = pair_windows(*size, offset)
        is_linked = (affinities[OFFSETS.index(offset)][first] > _LINKED) & foreground[first] & foreground[second]
        for here, there in ((first, second), (second, first)):
            is_better = is_linked & (height[there] > best[here])
            best[here] = np.where(is_better, height[there], best[here])
            target[here] = np.where(is_better, cells[there], target[here])
        equal = is_linked & (height[first] == height[second])
        level.append(np.stack([cells[first][equal], cells[second][equal]]))
    return _join_level_peaks(target.ravel(), np.concatenate(level, axis=1))


def _join_level_peaks(
    target: Int64[np.ndarray, "cells"], level: Int64[np.ndarray, "2 pairs"]
) -> Int64[np.ndarray, "cells"]:
    """Let neighbouring peaks of the same height be one."""
    is_peak = target == np.arange(len(target))
    a, b = level[:, is_peak[level].all(axis=0)]
    if not len(a):
        return target
    graph = coo_matrix((np.ones(len(a), bool), (a, b)), shape=(len(target), len(target)))
    component = connected_components(graph, directed=False)[1]
    first = np.unique(component, return_index=True)[1]
    return np.where(is_peak, first[component], target)
