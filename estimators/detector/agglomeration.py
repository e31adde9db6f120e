"""Average-linkage agglomeration of superpixels (GASP; Bailoni et al. 2022): the most alike are merged first."""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Int32, Int64

from simpick.estimators.detector.affinities import OFFSETS, pair_windows


@dataclass(frozen=True, eq=False)
class RegionPairs:
    """Pairs of regions, smaller number first. A region is a pair with itself, too: the affinities inside."""

    regions: Int64[np.ndarray, "pairs 2"]
    sums: Float[np.ndarray, "pairs"]
    """Of the affinities between them."""
    counts: Float[np.ndarray, "pairs"]
    """How many these are."""


@dataclass(frozen=True)
class Merge:
    """Two clusters that become one; each is named by one of its regions."""

    kept: int
    """Names the new cluster."""
    absorbed: int
    affinity: float
    """Mean between the two."""


def pair_regions(regions: Int32[np.ndarray, "h w"], affinities: Float32[np.ndarray, "offsets h w"]) -> RegionPairs:
    """Return the affinities between all regions, which are numbered from 1; 0 is background."""
    base = int(regions.max()) + 1
    keys, values = [], []
    for offset, affinity in zip(OFFSETS, affinities, strict=True):
        here, there = pair_windows(regions.shape[0], regions.shape[1], offset)
        first, second = regions[here].ravel(), regions[there].ravel()
        both = np.flatnonzero((first > 0) & (second > 0))
        first, second = first[both], second[both]
        keys.append(np.minimum(first, second).astype(np.int64) * base + np.maximum(first, second))
        values.append(affinity[here].ravel()[both])
    key, inverse = np.unique(np.concatenate(keys), return_inverse=True)
    sums = np.bincount(inverse, weights=np.concatenate(values), minlength=len(key)).astype(float)
    counts = np.bincount(inverse, minlength=len(key)).astype(float)
    return RegionPairs(np.stack([key // base, key % base], axis=1), sums, counts)


def agglomerate(count: int, pairs: RegionPairs, threshold: float) -> list[Merge]:
    """Return the merges of the regions 1 to `count`, in order, until no mean affinity is above `threshold`."""
    neighbours: list[dict[int, tuple[float, float]]] = [{} for _ in range(count + 1)]
    heap = []
    for (a, b), s, n in zip(pairs.regions.tolist(), pairs.sums.tolist(), pairs.counts.tolist(), strict=True):
        if a != b:
            neighbours[a][b] = neighbours[b][a] = (s, n)
            if s > threshold * n:
                heap.append((-s / n, n, a, b))
    heapq.heapify(heap)
    merges = []
    while heap:
        priority, n, a, b = heapq.heappop(heap)
        # Entries of clusters that have changed since are stale.
        current = neighbours[a].get(b)
        if current is None or current[1] != n or -current[0] / n != priority:
            continue
        if len(neighbours[a]) < len(neighbours[b]):
            a, b = b, a
        merges.append(Merge(a, b, -priority))
        del neighbours[a][b]
        for c, (s, m) in neighbours[b].items():
            if c == a:
                continue
            del neighbours[c][b]
            old_s, old_m = neighbours[a].get(c, (0.0, 0.0))
            merged = (old_s + s, old_m + m)
            neighbours[a][c] = neighbours[c][a] = merged
            if merged[0] > threshold * merged[1]:
                heapq.heappush(heap, (-merged[0] / merged[1], merged[1], a, c))
        neighbours[b] = {}
    return merges
