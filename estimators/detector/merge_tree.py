"""`MergeTree`: clusters of superpixels that surely belong together, and how they may be merged further."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Int32
from scipy.ndimage import find_objects

from simpick.estimators.detector.agglomeration import RegionPairs, agglomerate, pair_regions
from simpick.estimators.detector.superpixels import superpixels

MAX_SUPERPIXELS = 2000
"""An image of a full bin has some hundred. Of more than these, as noise gives, the largest count."""


@dataclass(frozen=True)
class Node:
    """A set of superpixels that may be an instance."""

    regions: tuple[int, ...]
    cells: int
    children: tuple[int, int] | None = None
    """The two nodes that it is merged of; None for what surely belongs together."""
    affinity: float = 1.0
    """Mean between the two."""


@dataclass(frozen=True, eq=False)
class MergeTree:
    """All nodes of an image."""

    regions: Int32[np.ndarray, "h w"]
    """Superpixel of each cell, from 1; 0 is background."""
    pairs: RegionPairs
    nodes: tuple[Node, ...]
    roots: tuple[int, ...]
    """Nodes that are in no other."""

    def cut(self, accept: Callable[[int], bool]) -> list[int]:
        """Return the uppermost nodes that are accepted or cannot be divided; each superpixel is in one of them."""
        chosen, open_nodes = [], list(self.roots)
        while open_nodes:
            k = open_nodes.pop()
            children = self.nodes[k].children
            if children is None or accept(k):
                chosen.append(k)
            else:
                open_nodes += children
        return sorted(chosen)

    def mask(self, node: int) -> Bool[np.ndarray, "h w"]:
        """Return the cells of a node."""
        regions = list(self.nodes[node].regions)
        is_member = np.zeros(len(self._windows) + 1, bool)
        is_member[regions] = True
        rows, columns = zip(*(self._windows[k - 1] for k in regions), strict=True)
        # Most nodes cover a small part of the image.
        window = tuple(slice(min(x.start for x in side), max(x.stop for x in side)) for side in (rows, columns))
        mask = np.zeros(self.regions.shape, bool)
        mask[window] = is_member[self.regions[window]]
        return mask

    @cached_property
    def _windows(self) -> list[tuple[slice, slice]]:
        """Rows and columns of each superpixel, from the first."""
        return find_objects(self.regions)


def merge_tree(
    foreground: Bool[np.ndarray, "h w"],
    affinities: Float32[np.ndarray, "offsets h w"],
    *,
    certain: float,
    possible: float,
) -> MergeTree:
    """Return the tree of an image: merges above the affinity `certain` are made, those above `possible` are nodes."""
    regions = _largest(superpixels(foreground, affinities))
    count = int(regions.max(initial=0))
    pairs = pair_regions(regions, affinities)
    cells = np.bincount(regions.ravel(), minlength=count + 1)
    nodes = {k: Node((k,), int(cells[k])) for k in range(1, count + 1)}
    current = {k: k for k in nodes}
    is_certain = True
    for merge in agglomerate(count, pairs, possible):
        is_certain &= merge.affinity >= certain
        a, b = current[merge.kept], current[merge.absorbed]
        first, second = nodes[a], nodes[b]
        new = len(nodes) + 1
        nodes[new] = Node(
            first.regions + second.regions,
            first.cells + second.cells,
            None if is_certain else (a, b),
            1.0 if is_certain else merge.affinity,
        )
        current[merge.kept] = new
        del current[merge.absorbed]
    # Node numbers begin at 1, as superpixels do; entry 0 is never used.
    listed = (Node((), 0), *(nodes[k] for k in sorted(nodes)))
    return MergeTree(regions, pairs, listed, tuple(sorted(current.values())))


def _largest(regions: Int32[np.ndarray, "h w"]) -> Int32[np.ndarray, "h w"]:
    """Return at most `MAX_SUPERPIXELS` regions, numbered again; the cells of smaller ones are background."""
    cells = np.bincount(regions.ravel())
    if len(cells) - 1 <= MAX_SUPERPIXELS:
        return regions
    kept = 1 + np.sort(np.argsort(-cells[1:], kind="stable")[:MAX_SUPERPIXELS])
    number = np.zeros(len(cells), np.int32)
    number[kept] = np.arange(1, MAX_SUPERPIXELS + 1)
    return number[regions]
