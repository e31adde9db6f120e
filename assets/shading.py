"""Normals for shading: smooth across a round surface's facets, sharp at its edges."""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

CREASE_DEG = 32.0
"""Facets that meet at a larger angle meet at an edge. Twelve facets to a turn still count as round."""


def split_at_creases(
    mesh: trimesh.Trimesh,
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"], Int[np.ndarray, "faces 3"]]:
    """Return vertices, their normals, and faces of the same surface with its vertices split along sharp edges.

    At a vertex, faces that are connected through edges flatter than `CREASE_DEG` share one normal: the mean of
    theirs, weighted by their angle at the vertex.
    """
    faces = np.asarray(mesh.faces)
    flat = np.asarray(mesh.face_adjacency_angles) < np.radians(CREASE_DEG)
    pairs, edges = np.asarray(mesh.face_adjacency)[flat], np.asarray(mesh.face_adjacency_edges)[flat]
    # A corner is 3 * face + place; two faces across a flat edge join their corners at both of the edge's vertices.
    corners = [
        3 * pairs[:, side, None] + np.argmax(faces[pairs[:, side]][:, None] == edges[:, :, None], axis=2)
        for side in (0, 1)
    ]
    ones = np.ones(2 * len(pairs), bool)
    links = coo_array((ones, (corners[0].ravel(), corners[1].ravel())), shape=(faces.size, faces.size))
    count, label = connected_components(links, directed=False)
    weighted = np.asarray(mesh.face_angles).reshape(-1, 1) * np.repeat(np.asarray(mesh.face_normals), 3, axis=0)
    normals = np.stack([np.bincount(label, weighted[:, axis], minlength=count) for axis in range(3)], axis=-1)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # A face without area has no normal; any unit vector serves, because nothing of it is drawn.
    normals = np.where(length > 1e-12, normals / np.maximum(length, 1e-12), np.array([0.0, 0.0, 1.0]))
    vertices = np.empty((count, 3))
    vertices[label] = np.asarray(mesh.vertices)[faces.ravel()]
    return vertices, normals, label.reshape(-1, 3)
