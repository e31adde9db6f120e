"""Share of each part that is exposed to a gripper from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

_CELL_M = 0.004
_BELOW_M = 0.003


def exposures(points_world: Sequence[Float[np.ndarray, "_ 3"]]) -> Float[np.ndarray, "parts"]:
    """Return for each part the share of its outline, seen from above, that no other part covers.

    `points_world` are points on each part's surface, about as dense as the 4 mm grid on which heights are compared.
    """
    if not points_world:
        return np.zeros(0)
    everything = np.concatenate(points_world)
    low = everything[:, :2].min(axis=0)
    size = tuple(np.ceil((everything[:, :2].max(axis=0) - low) / _CELL_M).astype(int) + 1)
    tops = []
    for points in points_world:
        top = np.full(size, -np.inf)
        cells = ((points[:, :2] - low) / _CELL_M).astype(int)
        np.maximum.at(top, (cells[:, 0], cells[:, 1]), points[:, 2])
        tops.append(top)
    stack = np.stack(tops)
    shares = []
    for k, top in enumerate(tops):
        others = np.delete(stack, k, axis=0)
        cover = others.max(axis=0) if len(others) else np.full(size, -np.inf)
        own = np.isfinite(top)
        shares.append(float((top >= cover - _BELOW_M)[own].mean()))
    return np.array(shares)
