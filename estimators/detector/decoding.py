"""From the network's maps to instances: a cut of the merge tree, and what the score of each instance is made of."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, Float32, Int32

from simpick.config import Config, Fraction, PositiveInt
from simpick.estimators.detector.affinities import STRIDE
from simpick.estimators.detector.merge_tree import MergeTree

_Share = Annotated[float, Interval(gt=0, lt=1)]


@dataclass(frozen=True)
class DecodingConfig(Config):
    """How instances are read from the maps."""

    foreground: Fraction = 0.5
    """Cells with at least this probability show a part."""
    certain: _Share = 0.7
    """Clusters with a mean affinity above this are merged whatever the parts look like."""
    merge: _Share = 0.35
    """Without knowledge of the parts, clusters with a mean affinity above this are merged."""
    possible: _Share = 0.1
    """Clusters with a mean affinity below this are never merged."""
    min_cells: PositiveInt = 18
    """Smaller instances are dropped."""


@dataclass(frozen=True, eq=False)
class Instances:
    """Instances of one image, by number."""

    labels: Int32[np.ndarray, "h w"]
    """Number of the instance in each cell, from 1; 0 is background."""
    features: Float[np.ndarray, "instances 4"]
    """Mean affinity inside, mean affinity to others, mean foreground, logarithm of the cells."""


def label_nodes(
    tree: MergeTree, nodes: Sequence[int], foreground: Float32[np.ndarray, "h w"], min_cells: int
) -> Instances:
    """Return these nodes of the tree as instances, without those of fewer cells than `min_cells`."""
    kept = [k for k in nodes if tree.nodes[k].cells >= min_cells]
    number = np.zeros(int(tree.regions.max(initial=0)) + 1, np.int32)
    for k, node in enumerate(kept, 1):
        number[list(tree.nodes[node].regions)] = k
    labels = number[tree.regions]
    first, second = number[tree.pairs.regions].T
    count = len(kept) + 1
    inside, outside = np.zeros((count, 2)), np.zeros((count, 2))
    amounts = np.stack([tree.pairs.sums, tree.pairs.counts], axis=1)
    is_inside = first == second
    # What was dropped is no other instance: a speck at the rim of a lone part says nothing of its neighbours.
    is_between = ~is_inside & (first > 0) & (second > 0)
    np.add.at(inside, first[is_inside], amounts[is_inside])
    for side in (first, second):
        np.add.at(outside, side[is_between], amounts[is_between])
    cells = np.maximum(np.bincount(labels.ravel(), minlength=count), 1)
    shown = np.bincount(labels.ravel(), weights=foreground.ravel(), minlength=count) / cells
    means = [sums[:, 0] / np.maximum(sums[:, 1], 1) for sums in (inside, outside)]
    features = np.stack([*means, shown, np.log(cells)], axis=1)
    return Instances(labels, features[1:])


def full_mask(
    cells: Bool[np.ndarray, "h w"], height: int, width: int, *, scale: tuple[float, float] = (1.0, 1.0)
) -> Bool[np.ndarray, "height width"]:
    """Return a mask at the image's size, its border interpolated between cells.

    A cell covers `STRIDE * scale` rows and columns of the image. Masks of disjoint cells are disjoint.

    Raises:
        IndexError: there are no cells.
    """
    (top, bottom), (left, right) = (
        (max(inside[0] - 1, 0), min(inside[-1] + 2, end))
        for inside, end in zip((np.flatnonzero(cells.any(axis=k)) for k in (1, 0)), cells.shape, strict=True)
    )
    per_row, per_column = (STRIDE * s for s in scale)
    y, y_end = math.floor(top * per_row), min(math.ceil(bottom * per_row), height)
    x, x_end = math.floor(left * per_column), min(math.ceil(right * per_column), width)
    # From pixels of the window to its cells; both have their centres at integers.
    to_cells = np.array(
        [
            [1 / per_column, 0, (x + 0.5) / per_column - 0.5 - left],
            [0, 1 / per_row, (y + 0.5) / per_row - 0.5 - top],
        ]
    )
    soft = cv2.warpAffine(
        cells[top:bottom, left:right].astype(np.float32),
        to_cells,
        (x_end - x, y_end - y),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    mask = np.zeros((height, width), bool)
    mask[y:y_end, x:x_end] = soft > 0.5
    return mask
