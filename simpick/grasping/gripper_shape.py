"""`GripperShape`: a gripper at one opening, as the planner tests it against the bin and points on other parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import Gripper
from simpick.assets.grippers.sampling.boxes import box_surface_points, swept_back

_ROUNDING_M = 1e-9


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
    extents: tuple[tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "3"]], ...]
    """The z in which a box ends, and the lower and upper corner of a box around all that reach at least as far; the
    first is around all."""

    @staticmethod
    def of(gripper: Gripper, opening_m: float, approach_m: float, clearance_m: float) -> GripperShape:
        """Return the shape of `gripper` at this opening for a straight approach of `approach_m`."""
        boxes = gripper.boxes(opening_m)
        solid, gripped = swept_back(boxes, approach_m), gripper.grip_boxes(opening_m)
        tested = np.concatenate([solid + clearance_m * np.array([[-1.0], [1.0]]), gripped])
        ends = tested[:, 1, 2]
        extents = []
        for end in np.unique(ends).tolist():
            lower, upper = tested[ends >= end].transpose(1, 0, 2)
            extents.append((end, lower.min(axis=0), upper.max(axis=0)))
        edges, corners = box_surface_points(boxes), tested.transpose(1, 2, 0)[..., None].copy()
        for array in (edges, corners, *(side for _, *sides in extents for side in sides)):
            array.flags.writeable = False
        return GripperShape(opening_m, edges, corners, len(solid), tuple(extents))

    def around_from(self, back_m: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Return lower and upper corner of a box around all boxes that reach further along the approach than this z."""
        reaching = (sides for end_m, *sides in self.extents if end_m > back_m - _ROUNDING_M)
        lower_m, upper_m = next(reaching, self.extents[-1][1:])
        return lower_m, upper_m

    def points_met(self, points: Float[np.ndarray, "n 3"]) -> tuple[int, bool]:
        """Return how many points, in the TCP frame, lie in the sweep, and whether any would be taken along."""
        x, y, z = points.T
        (left, front, bottom), (right, rear, top) = self.corners
        inside = (x > left) & (x < right)
        inside &= (y > front) & (y < rear)
        inside &= (z > bottom) & (z < top)
        swept = int(np.count_nonzero(inside[: self.solids].any(axis=0)))
        return swept, bool(inside[self.solids :].any())
