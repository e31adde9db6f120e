"""First repairs of a mesh from a file: what can be fixed without knowing what is inside and what outside."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from simpick.errors import MeshError

_WELDS = (1e-7, 1e-6, 1e-5, 1e-4)
"""Distances, over the mesh's longest side, within which the vertices of open edges are welded; the first that helps."""
_FAR = 1e4
_MOST_RIM_VERTICES = 20_000
_STRAY_SHARE = 0.3
"""Largest share of the surface that is dropped as loose faces."""
_SHEET_RIM = 3.0
"""A piece is a sheet, not a body with a hole, if its rim's squared length exceeds its area by this factor."""


def cleaned(mesh: trimesh.Trimesh, file: str) -> tuple[trimesh.Trimesh, Float[np.ndarray, "3"], list[str]]:
    """Return the mesh about the origin, by how much it was moved there, and notes on what was repaired.

    Vertices are merged, faces without area or twice the same are removed, seams are welded, and loose faces beside a
    closed body are dropped. Raises `MeshError` where no face is left.
    """
    notes: list[str] = []
    offset = np.asarray(mesh.bounds).mean(axis=0)
    mesh = trimesh.Trimesh(mesh.vertices - offset, mesh.faces, process=False)
    size = float(mesh.extents.max())
    if size <= 0:
        raise MeshError(f"{file}: every face is degenerate (no area). Export it again from CAD as a solid.")
    distance = float(np.linalg.norm(offset))
    if distance > _FAR * size:
        notes.append(
            f"{file}: lies {distance / size:.2g} times its size away from the origin, where coordinates in single "
            f"precision are rounded by {distance * 6e-8 / size:.1g} of its size; export it near the origin"
        )
    mesh = _merged(mesh)
    if len(mesh.faces) == 0:
        raise MeshError(f"{file}: every face is degenerate (no area). Export it again from CAD as a solid.")
    if open_edges(mesh):
        mesh = _welded(mesh, size, file, notes)
        mesh = _split_at_junctions(mesh, size, file, notes)
        mesh = _without_strays(mesh, file, notes)
    return mesh, offset, notes


def open_edges(mesh: trimesh.Trimesh) -> int:
    """Return how many edges belong to an odd number of faces: the rims of holes, sheets and loose faces."""
    return int((np.bincount(mesh.edges_unique_inverse) % 2 == 1).sum())


def open_edge_lines(mesh: trimesh.Trimesh) -> Float[np.ndarray, "n 2 3"]:
    """Return the end points of those edges."""
    odd = np.bincount(mesh.edges_unique_inverse) % 2 == 1
    return np.asarray(mesh.vertices)[np.asarray(mesh.edges_unique)[odd]]


def _merged(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh with equal vertices merged, without faces that are degenerate or twice the same."""
    mesh.merge_vertices()
    faces = np.asarray(mesh.faces)
    # Slivers stay: their corners differ, and without them a closed mesh would be open.
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    mesh.update_faces(distinct & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    return mesh


def _welded(mesh: trimesh.Trimesh, size: float, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return the mesh with seams closed by the smallest weld that leaves fewest open edges."""
    before = open_edges(mesh)
    best, fewest, width = mesh, before, 0.0
    for share in _WELDS:
        candidate = _weld(mesh, share * size)
        count = open_edges(candidate) if len(candidate.faces) else before
        if count < fewest:
            best, fewest, width = candidate, count, share * size
        if fewest == 0:
            break
    if best is not mesh:
        notes.append(f"{file}: welded seams up to {width:.1g} file units wide ({before - fewest} open edges closed)")
    return best


def _weld(mesh: trimesh.Trimesh, distance: float) -> trimesh.Trimesh:
    """Return the mesh with vertices within this distance of each other merged into their mean."""
    vertices = np.asarray(mesh.vertices)
    pairs = KDTree(vertices).query_pairs(distance, output_type="ndarray")
    ones = np.ones(len(pairs), bool)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(len(vertices), len(vertices)))
    count, label = connected_components(graph, directed=False)
    sums = np.stack([np.bincount(label, vertices[:, k], count) for k in range(3)], axis=-1)
    return _merged(
        trimesh.Trimesh(sums / np.bincount(label, minlength=count)[:, None], label[mesh.faces], process=False)
    )


def _split_at_junctions(mesh: trimesh.Trimesh, size: float, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return the mesh with faces split where a vertex of a neighbour lies on their open edge (T-junctions)."""
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    once = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    edges, owners = np.asarray(mesh.edges)[once], np.asarray(mesh.edges_face)[once]
    rim = np.unique(edges)
    if not len(rim) or len(rim) > _MOST_RIM_VERTICES:
        return mesh
    split: dict[int, list[tuple[int, np.ndarray]]] = {}
    for (start, end), face in zip(edges, owners, strict=True):
        along = vertices[end] - vertices[start]
        t = (vertices[rim] - vertices[start]) @ along / max(float(along @ along), 1e-300)
        gap = np.linalg.norm(vertices[rim] - vertices[start] - t[:, None] * along, axis=1)
        on = (t > 1e-6) & (t < 1 - 1e-6) & (gap < _WELDS[-1] * size) & (rim != start) & (rim != end)
        if on.any():
            split.setdefault(int(face), []).append((int(start), rim[on][np.argsort(t[on])]))
    if not split:
        return mesh
    new = [triangle for face, cuts in split.items() for triangle in _fan(faces[face].tolist(), dict(cuts))]
    whole = trimesh.Trimesh(vertices, np.concatenate([np.delete(faces, list(split), axis=0), new]), process=False)
    if open_edges(whole) >= open_edges(mesh):
        return mesh
    notes.append(f"{file}: split {len(split)} faces where a neighbour's vertex lies on their edge (T-junctions)")
    return whole


def _fan(face: list[int], cuts: dict[int, np.ndarray]) -> list[list[int]]:
    """Return triangles that fill a triangle with vertices on its edges, by the corner at which the edge starts."""
    for turn in range(3):
        a, b, c = face[turn:] + face[:turn]
        if a in cuts:
            chain = [a, *cuts[a].tolist(), b]
            triangles = [[p, q, c] for p, q in pairwise(chain)]
            # The other edges' vertices fall to the first and the last triangle, which have those edges.
            first = _fan(triangles[0], {c: cuts[c]} if c in cuts else {})
            last = _fan(triangles[-1], {b: cuts[b]} if b in cuts else {})
            return [*first, *triangles[1:-1], *last]
    return [face]


def _without_strays(mesh: trimesh.Trimesh, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return the mesh without loose sheets beside larger bodies."""
    pieces = trimesh.graph.connected_components(
        mesh.face_adjacency, nodes=np.arange(len(mesh.faces)), min_len=1, engine="scipy"
    )
    stray = [np.asarray(piece) for piece in pieces if _is_sheet(mesh, np.asarray(piece))]
    if not stray or len(stray) == len(pieces):
        return mesh
    loose = np.concatenate(stray)
    areas = np.asarray(mesh.area_faces)
    if areas[loose].sum() > _STRAY_SHARE * areas.sum():
        return mesh
    kept = trimesh.Trimesh(mesh.vertices, np.delete(np.asarray(mesh.faces), loose, axis=0), process=False)
    centre = np.asarray(mesh.triangles_center)[loose].mean(axis=0)
    notes.append(
        f"{file}: dropped {len(loose)} loose faces that belong to no closed surface, near "
        f"({', '.join(f'{x:.3g}' for x in centre)}) from the middle, in file units"
    )
    kept.remove_unreferenced_vertices()
    return kept


def _is_sheet(mesh: trimesh.Trimesh, piece: np.ndarray) -> bool:
    faces = trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[piece], process=False)
    rim = open_edge_lines(faces)
    return float(np.linalg.norm(rim[:, 1] - rim[:, 0], axis=1).sum()) ** 2 > _SHEET_RIM * float(faces.area)
