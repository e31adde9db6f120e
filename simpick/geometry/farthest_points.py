"""Farthest-point sampling."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from simpick.errors import ConfigError


def farthest_points(points: Float[np.ndarray, "n 3"], count: int) -> Int[np.ndarray, "count"]:
    """Return indices of `count` points, each the farthest from all before it; the first is farthest from the mean.

    Deterministic: ties go to the first point in the list.

    Raises:
        ConfigError: `count` is not between 1 and the number of points.
    """
    if not 1 <= count <= len(points):
        raise ConfigError(f"count of farthest points must be between 1 and {len(points)}, got {count}")
    points = np.asarray(points, float)
    chosen = np.empty(count, int)
    chosen[0] = np.argmax(((points - points.mean(0)) ** 2).sum(-1))
    distance_sq = ((points - points[chosen[0]]) ** 2).sum(-1)
    for i in range(1, count):
        chosen[i] = np.argmax(distance_sq)
        distance_sq = np.minimum(distance_sq, ((points - points[chosen[i]]) ** 2).sum(-1))
    return chosen
