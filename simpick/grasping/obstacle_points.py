"""`ObstaclePoints`: points on other parts, for the question which of them may lie in a gripper's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class ObstaclePoints:
    """Points in the world in rising order of y, so that those in a range of y are a slice."""

    columns_m: Float[np.ndarray, "3 n"]
    """Their coordinates; along memory each, for every test reads one after the other."""
    top_m: float
    """Height of the highest."""

    @staticmethod
    def of(points_m: Float[np.ndarray, "n 3"]) -> ObstaclePoints:
        """Return these points in order."""
        return ObstaclePoints.from_ordered(points_m[np.argsort(points_m[:, 1], kind="stable")].T)

    @staticmethod
    def from_ordered(columns_m: Float[np.ndarray, "3 n"]) -> ObstaclePoints:
        """Return these points, which are in order."""
        return ObstaclePoints(np.ascontiguousarray(columns_m), float(columns_m[2].max(initial=-np.inf)))

    def where(self, kept: Bool[np.ndarray, "n"]) -> ObstaclePoints:
        """Return these of the points."""
        return ObstaclePoints.from_ordered(self.columns_m[:, kept])

    def distances_m(self, point_m: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n"]:
        """Return how far each is from a point in the world."""
        return np.linalg.norm(self.columns_m - point_m[:, None], axis=0)

    def around_box(
        self,
        T_world_box: Float[np.ndarray, "4 4"],
        lower_m: Float[np.ndarray, "3"],
        upper_m: Float[np.ndarray, "3"],
    ) -> Float[np.ndarray, "m 3"]:
        """Return all points in a box that is aligned with a frame, and some beside it, in that frame.

        Those within the box's extent along the world's x and y are taken; of a box whose z axis points down, only what
        is no higher than the highest point has an extent.
        """
        # Numbers instead of arrays, for these are a few products, thousands of times per pick.
        (xx, xy, xz, x), (yx, yy, yz, y), (zx, zy, zz, z), _ = T_world_box.tolist()
        (left, front, back), (right, rear, tip) = lower_m.tolist(), upper_m.tolist()
        mid_x, mid_y, half_x, half_y = (left + right) / 2, (front + rear) / 2, (right - left) / 2, (rear - front) / 2
        if zz < -0.1:
            lowest_side = zx * mid_x + zy * mid_y - abs(zx) * half_x - abs(zy) * half_y
            back = min(max(back, (self.top_m - z - lowest_side) / zz), tip)
        mid_z, half_z = (back + tip) / 2, (tip - back) / 2
        x += xx * mid_x + xy * mid_y + xz * mid_z
        y += yx * mid_x + yy * mid_y + yz * mid_z
        beside_x = abs(xx) * half_x + abs(xy) * half_y + abs(xz) * half_z
        beside_y = abs(yx) * half_x + abs(yy) * half_y + abs(yz) * half_z
        first, last = self.columns_m[1].searchsorted((y - beside_y, y + beside_y)).tolist()
        x_m = self.columns_m[0, first:last]
        near = ((x_m >= x - beside_x) & (x_m <= x + beside_x)).nonzero()[0]
        columns_m = self.columns_m[:, first:last].take(near, axis=1)
        return (T_world_box[:3, :3].T @ (columns_m - T_world_box[:3, 3:])).T
