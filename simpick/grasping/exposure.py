"""Share of each part that is exposed to a gripper from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from simpick.grasping.height_grid import HeightGrid

_BELOW_M = 0.003


def exposures(points_world: Sequence[Float[np.ndarray, "_ 3"]]) -> Float[np.ndarray, "parts"]:
    """Return for each part the share of its outline, seen from above, that no other part covers.

    `points_world` are points on each part's surface, about as dense as the 4 mm grid on which heights are compared.
    """
    if not points_world:
        return np.zeros(0)
    grid = HeightGrid.around(points_world)
    tops = np.stack([grid.top(points) for points in points_world])
    shares = []
    for k, top in enumerate(tops):
        others = np.delete(tops, k, axis=0)
        cover = others.max(axis=0) if len(others) else np.full(grid.shape, -np.inf)
        own = np.isfinite(top)
        shares.append(float((top >= cover - _BELOW_M)[own].mean()) if own.any() else 0.0)
    return np.array(shares)
