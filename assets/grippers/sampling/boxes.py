"""Points against boxes that are aligned with a frame: the collision test of grasp sampling and filtering."""

from __future__ import annotations

import itertools
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from simpick.assets.grippers.base import GripperBoxes


def points_in_boxes(
    points: Float[np.ndarray, "*batch n 3"], boxes: GripperBoxes, margin_m: float = 0.0
) -> Bool[np.ndarray, "*batch n"]:
    """Return which points lie in any of the boxes, grown by `margin_m`, all in the boxes' frame."""
    x, y, z = np.ascontiguousarray(np.moveaxis(points, -1, 0))
    # All boxes at once: most questions are about a few hundred points.
    corners = boxes.transpose(1, 2, 0).reshape(2, 3, -1, *(1,) * x.ndim)
    (left, front, bottom), (right, rear, top) = corners[0] - margin_m, corners[1] + margin_m
    inside = (x > left) & (x < right)
    inside &= (y > front) & (y < rear)
    inside &= (z > bottom) & (z < top)
    return inside.any(axis=0)


def swept_back(boxes: GripperBoxes, distance_m: float) -> GripperBoxes:
    """Return the boxes' sweep over the last `distance_m` of a straight approach along +z."""
    swept = boxes.copy()
    swept[:, 0, 2] -= distance_m
    return swept


def box_surface_points(boxes: GripperBoxes, spacing_m: float = 0.012) -> Float[np.ndarray, "n 3"]:
    """Return points along the long edges (z) of the boxes, dense enough to notice a thin wall between corners."""
    # The planner asks thousands of times per pick, for boxes that differ across the approach alone.
    pick_x, pick_y, z = _edges(boxes[:, :, 2].tobytes(), spacing_m)
    corners = boxes.ravel()
    return np.stack([corners[pick_x], corners[pick_y], z], axis=1)


@lru_cache(maxsize=64)
def _edges(ends: bytes, spacing_m: float) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Return where x and y of each point stand among the flattened boxes with these ends in z, and its z."""
    pick_x, pick_y, zs = [], [], []
    for box, (lower, upper) in enumerate(np.frombuffer(ends).reshape(-1, 2)):
        steps = max(2, int(np.ceil((upper - lower) / spacing_m)) + 1)
        for x, y in itertools.product((6 * box, 6 * box + 3), (6 * box + 1, 6 * box + 4)):
            pick_x += [x] * steps
            pick_y += [y] * steps
            zs.append(np.linspace(lower, upper, steps))
    return np.array(pick_x), np.array(pick_y), np.concatenate(zs)
