"""`GripperShape`: a gripper at one opening, as the planner tests it against the bin and points on other parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import Gripper
from simpick.assets.grippers.sampling.boxes import box_surface_points, swept_back


@dataclass(frozen=True, eq=False)
class GripperShape:
    """What follows from gripper, opening, approach and clearance alone, in the TCP frame. Arrays are read-only."""

    opening_m: float
    edges: Float[np.ndarray, "n 3"]
    """Points along the open gripper's long edges."""
    corners: Float[np.ndarray, "2 3 boxes 1"]
    """Lower and upper corners of the boxes in which no point may lie: of the gripper's sweep over the approach, grown
    by the clearance, and then of what the closing gripper would take along."""
    solids: int
    """How many of the boxes are the gripper's sweep."""
    lower_m: Float[np.ndarray, "3"]
    """Lower corner of a box around all of them."""
    upper_m: Float[np.ndarray, "3"]

    @staticmethod
    def of(gripper: Gripper, opening_m: float, approach_m: float, clearance_m: float) -> GripperShape:
        """Return the shape of `gripper` at this opening for a straight approach of `approach_m`."""
        boxes = gripper.boxes(opening_m)
        solid, gripped = swept_back(boxes, approach_m), gripper.grip_boxes(opening_m)
        both = np.concatenate([solid, gripped])
        lower_m, upper_m = both[:, 0].min(axis=0) - clearance_m, both[:, 1].max(axis=0) + clearance_m
        grown = solid + clearance_m * np.array([[-1.0], [1.0]])
        corners = np.concatenate([grown, gripped]).transpose(1, 2, 0)[..., None].copy()
        shape = GripperShape(opening_m, box_surface_points(boxes), corners, len(solid), lower_m, upper_m)
        for array in (shape.edges, shape.corners, shape.lower_m, shape.upper_m):
            array.flags.writeable = False
        return shape

    def points_met(self, points: Float[np.ndarray, "n 3"]) -> tuple[int, bool]:
        """Return how many points, in the TCP frame, lie in the sweep, and whether any would be taken along."""
        x, y, z = points.T
        (left, front, bottom), (right, rear, top) = self.corners
        inside = (x > left) & (x < right)
        inside &= (y > front) & (y < rear)
        inside &= (z > bottom) & (z < top)
        swept = int(np.count_nonzero(inside[: self.solids].any(axis=0)))
        return swept, bool(inside[self.solids :].any())
