"""Points against boxes that are aligned with a frame: the collision test of grasp sampling and filtering."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from simpick.assets.grippers.base import GripperBoxes


def points_in_boxes(
    points: Float[np.ndarray, "*batch n 3"], boxes: GripperBoxes, margin_m: float = 0.0
) -> Bool[np.ndarray, "*batch n"]:
    """Return which points lie in any of the boxes, grown by `margin_m`, all in the boxes' frame."""
    inside = np.zeros(points.shape[:-1], bool)
    x, y, z = np.moveaxis(points, -1, 0)
    for lower, upper in boxes:
        lo, hi = lower - margin_m, upper + margin_m
        inside |= (x > lo[0]) & (x < hi[0]) & (y > lo[1]) & (y < hi[1]) & (z > lo[2]) & (z < hi[2])
    return inside


def swept_back(boxes: GripperBoxes, distance_m: float) -> GripperBoxes:
    """Return the boxes' sweep over the last `distance_m` of a straight approach along +z."""
    swept = boxes.copy()
    swept[:, 0, 2] -= distance_m
    return swept


def box_surface_points(boxes: GripperBoxes, spacing_m: float = 0.012) -> Float[np.ndarray, "n 3"]:
    """Return points along the long edges (z) of the boxes, dense enough to notice a thin wall between corners."""
    found = []
    for lower, upper in boxes:
        steps = max(2, int(np.ceil((upper[2] - lower[2]) / spacing_m)) + 1)
        z = np.linspace(lower[2], upper[2], steps)
        # Filled in place: the planner calls this tens of thousands of times per episode.
        edges = np.empty((2, 2, steps, 3))
        edges[:, :, :, 0] = np.array([lower[0], upper[0]])[:, None, None]
        edges[:, :, :, 1] = np.array([lower[1], upper[1]])[:, None]
        edges[:, :, :, 2] = z
        found.append(edges.reshape(-1, 3))
    return np.concatenate(found)
