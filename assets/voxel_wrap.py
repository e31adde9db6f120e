"""Wrapping a defective surface in a closed one: the level set of a distance field on a grid, signed from outside."""

from __future__ import annotations

import numpy as np
import trimesh
from manifold3d import Manifold
from scipy import ndimage
from scipy.spatial import KDTree

from simpick.assets.csg import to_trimesh

_CELLS = 64
"""Grid cells along the longest side."""
_BAND = 1.5
"""Gaps up to twice this many cells wide are closed."""
_SAMPLES = 100_000


def wrapped(mesh: trimesh.Trimesh) -> trimesh.Trimesh | None:
    """Return a closed surface around what `mesh` encloses, or None if it encloses nothing.

    A flood from outside that keeps 1.5 cells away from the surface finds what lies outside; the distance to the
    surface, signed by it, has the wrap as its zero level. Surfaces inside disappear, gaps below 3 cells are closed.
    """
    pitch = float(mesh.extents.max()) / _CELLS
    band = _BAND * pitch
    low = np.asarray(mesh.bounds)[0] - 4 * pitch
    shape = np.ceil(np.asarray(mesh.extents) / pitch).astype(int) + 9
    points = np.asarray(trimesh.sample.sample_surface(mesh, _SAMPLES, seed=0)[0], float)
    grid = low + pitch * np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).reshape(-1, 3)
    distance = KDTree(points).query(grid, distance_upper_bound=4 * pitch)[0].reshape(shape)
    distance = np.minimum(distance, 4 * pitch)
    away = distance > band
    regions = np.zeros(shape, np.int32)
    ndimage.label(away, output=regions)
    outside = regions == regions[0, 0, 0]
    if not (away & ~outside).any():
        return None
    # The true surface lies one band inside the flood's edge, which passes between nodes; only the sign is from there.
    nearest = np.zeros((3, *shape), np.int32)
    steps = np.zeros(tuple(shape))
    ndimage.distance_transform_edt(~outside, distances=steps, return_indices=True, indices=nearest)
    i, j, k = nearest
    depth = steps * pitch - (distance[i, j, k] - band)
    signed = np.where(outside | (depth < band), -distance, distance)

    cells = signed.tolist()

    def field(x: float, y: float, z: float) -> float:
        u, v, w = (x - low[0]) / pitch, (y - low[1]) / pitch, (z - low[2]) / pitch
        i, j, k = (min(max(int(t), 0), n - 2) for t, n in ((u, shape[0]), (v, shape[1]), (w, shape[2])))
        u, v, w = u - i, v - j, w - k
        c = cells[i][j]
        d = cells[i + 1][j]
        e = cells[i][j + 1]
        f = cells[i + 1][j + 1]
        near = (1 - u) * ((1 - v) * c[k] + v * e[k]) + u * ((1 - v) * d[k] + v * f[k])
        far = (1 - u) * ((1 - v) * c[k + 1] + v * e[k + 1]) + u * ((1 - v) * d[k + 1] + v * f[k + 1])
        return (1 - w) * near + w * far

    high = low + pitch * (shape - 1)
    solid = Manifold.level_set(field, [*low.tolist(), *high.tolist()], pitch)
    bodies = [body for body in solid.decompose() if body.volume() > (2 * pitch) ** 3]
    if not bodies:
        return None
    return to_trimesh(Manifold.compose(bodies).simplify(0.2 * pitch))
