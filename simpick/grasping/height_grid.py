"""`HeightGrid`: heights of surfaces over the bin's floor, on a grid seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

CELL_M = 0.004
_HALF_SIDE_M = 1.0
"""Points further than this from the median point, along either axis, are left out: they are in no bin."""


@dataclass(frozen=True, eq=False)
class HeightGrid:
    """A grid of 4 mm cells over the bin."""

    lower_m: Float[np.ndarray, "2"]
    shape: tuple[int, int]

    @staticmethod
    def around(points: Sequence[Float[np.ndarray, "_ 3"]]) -> HeightGrid:
        """Return the grid that encloses these points in the world, at most 2 m wide; there must be some."""
        everything = np.concatenate(points)[:, :2]
        middle = np.median(everything, axis=0)
        lower = np.maximum(everything.min(axis=0), middle - _HALF_SIDE_M)
        upper = np.minimum(everything.max(axis=0), middle + _HALF_SIDE_M)
        rows, columns = (np.floor((upper - lower) / CELL_M).astype(int) + 1).tolist()
        return HeightGrid(lower, (rows, columns))

    def tops(self, clouds: Sequence[Float[np.ndarray, "_ 3"]]) -> Float[np.ndarray, "parts rows columns"]:
        """Return `top` of each of several parts."""
        owners = np.repeat(np.arange(len(clouds)), [len(points) for points in clouds])
        return self._extreme(np.maximum, -np.inf, np.concatenate(clouds), owners, len(clouds))

    def top(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "rows columns"]:
        """Return the height of the highest point of each cell; minus infinity where there is none."""
        return self.tops([points])[0]

    def bottom(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "rows columns"]:
        """Return the height of the lowest point of each cell; infinity where there is none."""
        return self._extreme(np.minimum, np.inf, points, np.zeros(len(points), int), 1)[0]

    def _extreme(
        self,
        choose: np.ufunc,
        nothing: float,
        points: Float[np.ndarray, "n 3"],
        owners: Int[np.ndarray, "n"],
        count: int,
    ) -> Float[np.ndarray, "count rows columns"]:
        heights = np.full((count, *self.shape), nothing)
        cells = np.floor((points[:, :2] - self.lower_m) / CELL_M).astype(int)
        inside = ((cells >= 0) & (cells < self.shape)).all(axis=1)
        rows, columns = cells[inside].T
        # A flat index: `at` takes several times as long with one for each axis.
        at = (owners[inside] * self.shape[0] + rows) * self.shape[1] + columns
        choose.at(heights.reshape(-1), at, points[inside, 2])
        return heights
