"""Generalised winding numbers (Jacobson 2013): how often a surface surrounds a point."""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float

from simpick.assets.csg import to_manifold, to_trimesh

_POINTS = 800
_MOST_FACES = 2000
_CHUNK = 2_000_000


def winding_numbers(mesh: trimesh.Trimesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Return the surface's solid angle over 4 pi as seen from each point (van Oosterom and Strackee 1983)."""
    triangles = np.asarray(mesh.triangles)
    result = []
    for chunk in np.array_split(points, max(1, len(points) * len(triangles) // _CHUNK)):
        a, b, c = (triangles[None, :, k] - chunk[:, None] for k in range(3))
        la, lb, lc = (np.sqrt(np.einsum("nfi,nfi->nf", x, x)) for x in (a, b, c))
        volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
        ab, bc, ca = (np.einsum("nfi,nfi->nf", x, y) for x, y in ((a, b), (b, c), (c, a)))
        result.append(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2 * np.pi))
    return np.concatenate(result)


def misplaced_share(mesh: trimesh.Trimesh) -> float:
    """Return which share of what a closed mesh encloses lies inside it more than once, or inside out."""
    solid = to_manifold(mesh)
    plain = solid
    tolerance = 1e-3 * float(mesh.extents.max())
    while plain.num_tri() > _MOST_FACES and tolerance < 0.02 * float(mesh.extents.max()):
        plain = solid.simplify(tolerance)
        tolerance *= 2
    if plain.is_empty():
        plain = solid
    low, high = np.asarray(mesh.bounds)
    points = np.random.default_rng(0).uniform(low, high, (_POINTS, 3))
    times = np.round(winding_numbers(to_trimesh(plain), points))
    inside = times != 0
    return float((inside & (times != 1)).sum() / max(1, inside.sum()))
