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
        # Along memory, in which a median takes a tenth of the time.
        columns = np.concatenate(points)[:, :2].T.copy()
        middle = np.array([np.median(column) for column in columns])
        lower = np.maximum(columns.min(axis=1), middle - _HALF_SIDE_M)
        upper = np.minimum(columns.max(axis=1), middle + _HALF_SIDE_M)
        across, along = (np.floor((upper - lower) / CELL_M).astype(int) + 1).tolist()
        return HeightGrid(lower, (across, along))

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
        x, y, z = points.T
        # As floats, which need no rounding to integers to be compared.
        rows, columns = np.floor((x - self.lower_m[0]) / CELL_M), np.floor((y - self.lower_m[1]) / CELL_M)
        inside = (rows >= 0) & (columns >= 0) & (rows < self.shape[0]) & (columns < self.shape[1])
        if not inside.all():
            rows, columns, z, owners = rows[inside], columns[inside], z[inside], owners[inside]
        # A flat index: `at` takes several times as long with one for each axis.
        at = (owners * self.shape[0] + rows.astype(int)) * self.shape[1] + columns.astype(int)
        choose.at(heights.reshape(-1), at, z)
        return heights
