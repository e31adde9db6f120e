"""Points on a triangle mesh: uniform over its area, and farthest-point sampling."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from simpick.errors import ConfigError, MeshError


def sample_surface(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3"]]:
    """Return `count` points, uniform over the mesh's area, and the unit outward normals of their faces.

    Raises:
        MeshError: the mesh has no face with an area, or a vertex that is not finite.
        ConfigError: `count` is below 1.
    """
    if count < 1:
        raise ConfigError(f"count of surface points must be 1 or more, got {count}")
    a, b, c = np.moveaxis(np.asarray(vertices, float)[np.asarray(faces)], 1, 0)
    cross = np.cross(b - a, c - a)
    double_area = np.linalg.norm(cross, axis=-1)
    total = double_area.sum()
    if not (np.isfinite(total) and total > 0):
        raise MeshError("surface points need a mesh with finite vertices and a face that has an area; repair the mesh")
    # Searching the cumulative area never draws a face without area, which rounded probabilities might.
    face = np.searchsorted(np.cumsum(double_area), rng.random(count) * total, side="right")
    face = np.minimum(face, np.flatnonzero(double_area)[-1])
    # The square root makes the distribution uniform inside each triangle.
    s, t = np.sqrt(rng.random(count))[:, None], rng.random(count)[:, None]
    points = (1 - s) * a[face] + s * (1 - t) * b[face] + s * t * c[face]
    return points, cross[face] / double_area[face, None]


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
