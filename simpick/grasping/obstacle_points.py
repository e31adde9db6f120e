"""`ObstaclePoints`: points on other parts, for the question which of them may lie in a gripper's way."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class ObstaclePoints:
    """Points in the world in rising order of y, so that those in a range of y are a slice."""

    columns_m: Float[np.ndarray, "3 n"]
    """Their coordinates; along memory each, for every test reads one after the other."""
    owners: Int[np.ndarray, "n"]
    """Which part each is on."""
    top_m: float
    """Height of the highest."""

    @staticmethod
    def of(clouds_m: Sequence[Float[np.ndarray, "_ 3"]]) -> ObstaclePoints:
        """Return the points on these parts; the k-th cloud is that of part k."""
        owners = np.repeat(np.arange(len(clouds_m)), [len(cloud) for cloud in clouds_m])
        columns_m = np.concatenate([np.zeros((0, 3)), *clouds_m]).T
        order = np.argsort(columns_m[1])
        return ObstaclePoints._ordered(columns_m[:, order], owners[order])

    @staticmethod
    def _ordered(columns_m: Float[np.ndarray, "3 n"], owners: Int[np.ndarray, "n"]) -> ObstaclePoints:
        return ObstaclePoints(np.ascontiguousarray(columns_m), owners, float(columns_m[2].max(initial=-np.inf)))

    def of_owners(self, owners: Collection[int]) -> ObstaclePoints:
        """Return those on these parts."""
        kept = np.isin(self.owners, list(owners))
        return ObstaclePoints._ordered(self.columns_m[:, kept], self.owners[kept])

    def back_m(
        self,
        T_world_box: Float[np.ndarray, "4 4"],
        lower_m: Float[np.ndarray, "3"],
        upper_m: Float[np.ndarray, "3"],
    ) -> float:
        """Return the least z that any point in the box can have, in the box's frame.

        Of a box whose z axis points down, what is higher than the highest point is empty.
        """
        # Numbers instead of arrays, for these are a few products, hundreds of times per pick.
        (zx, zy, zz, z), (left, front, back), (right, rear, tip) = (
            T_world_box[2].tolist(),
            lower_m.tolist(),
            upper_m.tolist(),
        )
        if zz > -0.1:
            return back
        lowest_side = zx * (left + right) / 2 + zy * (front + rear) / 2
        lowest_side -= (abs(zx) * (right - left) + abs(zy) * (rear - front)) / 2
        return min(max(back, (self.top_m - z - lowest_side) / zz), tip)

    def around_box(
        self,
        T_world_box: Float[np.ndarray, "4 4"],
        lower_m: Float[np.ndarray, "3"],
        upper_m: Float[np.ndarray, "3"],
        beside: int = -1,
    ) -> Float[np.ndarray, "m 3"]:
        """Return all points in a box that is aligned with a frame, and some around it, in that frame.

        Those on part `beside` are left out.
        Those within the box's extent along the world's x and y are taken, as far as `back_m` lets it reach.
        """
        (xx, xy, xz, x), (yx, yy, yz, y), *_ = T_world_box.tolist()
        (left, front, _), (right, rear, tip) = lower_m.tolist(), upper_m.tolist()
        back = self.back_m(T_world_box, lower_m, upper_m)
        mid_x, mid_y, half_x, half_y = (left + right) / 2, (front + rear) / 2, (right - left) / 2, (rear - front) / 2
        mid_z, half_z = (back + tip) / 2, (tip - back) / 2
        x += xx * mid_x + xy * mid_y + xz * mid_z
        y += yx * mid_x + yy * mid_y + yz * mid_z
        beside_x = abs(xx) * half_x + abs(xy) * half_y + abs(xz) * half_z
        beside_y = abs(yx) * half_x + abs(yy) * half_y + abs(yz) * half_z
        first, last = self.columns_m[1].searchsorted((y - beside_y, y + beside_y)).tolist()
        x_m = self.columns_m[0, first:last]
        near = (x_m >= x - beside_x) & (x_m <= x + beside_x)
        near &= self.owners[first:last] != beside
        columns_m = self.columns_m[:, first:last].take(near.nonzero()[0], axis=1)
        return (T_world_box[:3, :3].T @ (columns_m - T_world_box[:3, 3:])).T
