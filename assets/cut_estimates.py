"""What cutting a solid by each of many planes would gain, estimated for all of them at once.

A cut by CSG costs milliseconds, and a piece has about ninety candidate planes. Here clipped volumes come from array
arithmetic, bodies from the connected vertices on each side, and only hulls are computed one by one.
"""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float, Int, Int8
from manifold3d import Manifold
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

_ON_PLANE = 1e-9
"""Vertices within this share of the longest side lie on a plane."""


def cut_costs(
    mesh: trimesh.Trimesh, planes: Float[np.ndarray, "p 4"], *, crumb: float, price: float
) -> Float[np.ndarray, "p"]:
    """Return, per plane, the sum over its cut's bodies of their hull's excess times the root of the hull's volume.

    Planes are rows of unit normal and offset. Bodies below a tenth of the volume `crumb` are left out, each above two
    costs `price`, and a plane with less than `crumb` on a side costs infinitely much. Exact but for a body whose shells
    are joined by the cut's face alone: an inner shell is counted with the smallest body whose box holds it.
    """
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    heights = planes[:, :3] @ vertices.T - planes[:, 3:]
    # What lies on the plane connects nothing: planes along faces would else join what stands on the face.
    heights[np.abs(heights) < _ON_PLANE * float(mesh.extents.max())] = 0.0
    signs = np.sign(heights).astype(np.int8)
    edges = np.asarray(mesh.edges_unique)
    labels, count = _bodies(signs, edges)
    sides = np.empty(count, int)
    sides[labels] = 2 * np.arange(len(planes))[:, None] + (signs > 0)
    volumes = _volumes(vertices, faces, planes, heights, labels, count)
    points, owners = _points(vertices, edges, heights, labels)
    # Sorted, because Manifold's hull of the same points in other orders is too large at times.
    points = points[np.lexsort((*points.T[::-1], owners))]
    starts = np.cumsum(np.bincount(owners, minlength=count))[:-1]
    boxes = np.stack([bound.reduceat(points, np.append(0, starts)) for bound in (np.minimum, np.maximum)])
    hulls = np.array([
        Manifold.hull_points(group).volume() if volume > 0.1 * crumb else 0.0
        for group, volume in zip(np.split(points, starts), volumes, strict=True)
    ])  # fmt: skip
    volumes = _with_inner_shells(volumes, hulls, boxes, sides)
    costs = np.bincount(sides // 2, np.maximum(hulls - volumes, 0.0) * np.sqrt(hulls), len(planes))
    costs += price * (np.bincount(sides // 2, hulls > 0, len(planes)) - 2)
    smaller = np.bincount(sides, volumes, 2 * len(planes)).reshape(-1, 2).min(axis=1)
    return np.where(smaller < crumb, np.inf, costs)


def _bodies(signs: Int8[np.ndarray, "p v"], edges: Int[np.ndarray, "e 2"]) -> tuple[Int[np.ndarray, "p v"], int]:
    """Return the number of the connected body that each vertex belongs to after each cut, and how many there are."""
    rows, kept = np.nonzero(signs[:, edges[:, 0]] * signs[:, edges[:, 1]] > 0)
    nodes = rows[:, None] * signs.shape[1] + edges[kept]
    graph = coo_matrix((np.ones(len(nodes), np.int8), nodes.T), shape=(signs.size, signs.size))
    count, labels = connected_components(graph, directed=False)
    return labels.reshape(signs.shape).astype(int), int(count)


def _points(
    vertices: Float[np.ndarray, "v 3"],
    edges: Int[np.ndarray, "e 2"],
    heights: Float[np.ndarray, "p v"],
    labels: Int[np.ndarray, "p v"],
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """Return the corners of all bodies, none twice, and the body of each: vertices, and where edges cross planes."""
    first, second = (heights[:, edges[:, k]] for k in range(2))
    rows, cut = np.nonzero(first * second < 0)
    start, end = edges[cut].T
    share = heights[rows, start] / (heights[rows, start] - heights[rows, end])
    crossings = vertices[start] + share[:, None] * (vertices[end] - vertices[start])
    sides = [labels[rows, start], labels[rows, end]]
    rows, cut = np.nonzero((first == 0) != (second == 0))
    start, end = edges[cut].T
    is_start = heights[rows, start] == 0
    touched, other = np.where(is_start, start, end), np.where(is_start, end, start)
    owner, touched = np.divmod(np.unique(labels[rows, other] * len(vertices) + touched), len(vertices))
    points = [np.tile(vertices, (len(heights), 1)), crossings, crossings, vertices[touched]]
    return np.concatenate(points), np.concatenate([labels.ravel(), *sides, owner])


def _volumes(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    planes: Float[np.ndarray, "p 4"],
    heights: Float[np.ndarray, "p v"],
    labels: Int[np.ndarray, "p v"],
    count: int,
) -> Float[np.ndarray, "count"]:
    """Return the volume of each body: cones from a point of the plane, over the share of each face on its side."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    apex = planes[:, :3] * planes[:, 3:]
    cones = (np.einsum("fi,fi->f", a, np.cross(b, c)) - apex @ np.cross(b - a, c - a).T) / 6
    high = np.stack([heights[:, faces[:, k]] for k in range(3)])
    above = high > 0
    number = above.sum(axis=0)
    mixed = (number == 1) | (number == 2)
    lone = np.argmax(above == (number == 1), axis=0)
    x, y, z = (np.take_along_axis(high, ((lone + k) % 3)[None], axis=0)[0][mixed] for k in range(3))
    corner = x * x / ((x - y) * (x - z))
    share = (number == 3).astype(float)
    share[mixed] = np.where(number[mixed] == 1, corner, 1 - corner)
    owner = np.stack([labels[:, faces[:, k]] for k in range(3)])
    upper = np.take_along_axis(owner, high.argmax(axis=0)[None], axis=0)[0]
    lower = np.take_along_axis(owner, high.argmin(axis=0)[None], axis=0)[0]
    volumes = np.bincount(upper.ravel(), (cones * share).ravel(), count)
    return volumes + np.bincount(lower.ravel(), (cones * (1 - share)).ravel(), count)


def _with_inner_shells(
    volumes: Float[np.ndarray, "n"],
    hulls: Float[np.ndarray, "n"],
    boxes: Float[np.ndarray, "2 n 3"],
    sides: Int[np.ndarray, "n"],
) -> Float[np.ndarray, "n"]:
    """Return the volumes, each inward shell (of negative volume) counted with the smallest body around it."""
    result = np.maximum(volumes, 0.0)
    low, high = boxes
    slack = _ON_PLANE * float((high - low).max())
    by_size = np.argsort(hulls, kind="stable")
    by_size = by_size[hulls[by_size] > 0]
    for shell in np.flatnonzero(volumes < 0):
        body = by_size[sides[by_size] == sides[shell]]
        around = (low[body] <= low[shell] + slack).all(axis=1) & (high[body] >= high[shell] - slack).all(axis=1)
        if around.any():
            result[body[around.argmax()]] += volumes[shell]
    return result
