"""Defective and odd meshes, made by code: what CAD exports, scans and careless modelling produce. Sizes in mm."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh
from numpy.typing import ArrayLike

from simpick.assets import get_part

BUILDERS: dict[str, Callable[[], trimesh.Trimesh]] = {}
"""Functions that build each mesh, by what is wrong with it."""

_Builder = Callable[[], trimesh.Trimesh]


def _defect(build: _Builder) -> _Builder:
    BUILDERS[build.__name__] = build
    return build


def bracket() -> trimesh.Trimesh:
    """Return the sound L that most of them are made of: 60 x 20 x 40 mm, 18000 mm3."""
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 40]).apply_translation([5, 10, 20])
    return trimesh.boolean.union([foot, leg])


BRACKET_MM3 = 18000.0


def library_mesh(name: str) -> trimesh.Trimesh:
    """Return a library part's mesh in mm."""
    return get_part(name).mesh.copy().apply_scale(1e3)


def soup(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return the mesh as an STL holds it: each triangle with its own corners."""
    return trimesh.Trimesh(np.asarray(mesh.triangles).reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3),
                           process=False)  # fmt: skip


def only(mesh: trimesh.Trimesh, faces: ArrayLike) -> trimesh.Trimesh:
    """Return these faces alone."""
    return without(mesh, np.setdiff1d(np.arange(len(mesh.faces)), np.asarray(faces)))


def without(mesh: trimesh.Trimesh, faces: ArrayLike) -> trimesh.Trimesh:
    """Return the mesh without these faces."""
    return trimesh.Trimesh(mesh.vertices, np.delete(np.asarray(mesh.faces), np.asarray(faces), axis=0), process=False)


def joined(*meshes: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return all faces in one mesh."""
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [np.asarray(mesh.faces) + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)


def flipped(mesh: trimesh.Trimesh, faces: slice | np.ndarray = slice(None)) -> trimesh.Trimesh:
    """Return the mesh with the winding of these faces reversed."""
    changed = np.asarray(mesh.faces).copy()
    changed[faces] = changed[faces][:, ::-1]
    return trimesh.Trimesh(mesh.vertices, changed, process=False)


def jittered(mesh: trimesh.Trimesh, sigma: float) -> trimesh.Trimesh:
    """Return a soup whose corners are each displaced by this much."""
    loose = soup(mesh)
    loose.vertices = loose.vertices + np.random.default_rng(0).normal(scale=sigma, size=loose.vertices.shape)
    return loose


@_defect
def unmerged_vertices() -> trimesh.Trimesh:
    return soup(bracket())


@_defect
def corners_off_by_1e_6() -> trimesh.Trimesh:
    return jittered(bracket(), 1e-6)


@_defect
def corners_off_by_1e_4() -> trimesh.Trimesh:
    return jittered(bracket(), 1e-4)


@_defect
def corners_off_by_1e_3() -> trimesh.Trimesh:
    return jittered(bracket(), 8e-4)


@_defect
def one_face_missing() -> trimesh.Trimesh:
    return without(bracket().subdivide(), [3])


@_defect
def two_neighbours_missing() -> trimesh.Trimesh:
    mesh = bracket().subdivide()
    return without(mesh, mesh.face_adjacency[0])


@_defect
def five_faces_missing() -> trimesh.Trimesh:
    return without(bracket().subdivide().subdivide(), [1, 40, 90, 150, 230])


@_defect
def a_vertex_torn_out() -> trimesh.Trimesh:
    mesh = bracket().subdivide().subdivide().subdivide()
    return without(mesh, np.flatnonzero((np.asarray(mesh.faces) == 11).any(axis=1)))


@_defect
def all_faces_inward() -> trimesh.Trimesh:
    return flipped(bracket())


@_defect
def some_faces_inward() -> trimesh.Trimesh:
    return flipped(bracket(), slice(None, None, 3))


@_defect
def every_face_twice() -> trimesh.Trimesh:
    return joined(bracket(), bracket())


@_defect
def every_face_twice_once_inward() -> trimesh.Trimesh:
    return joined(bracket(), flipped(bracket()))


@_defect
def some_faces_twice() -> trimesh.Trimesh:
    return joined(bracket(), without(bracket(), range(5)))


@_defect
def a_loose_triangle() -> trimesh.Trimesh:
    return joined(bracket(), trimesh.Trimesh([[80, 0, 0], [81, 0, 0], [80, 1, 0]], [[0, 1, 2]]))


@_defect
def a_loose_sheet() -> trimesh.Trimesh:
    sheet = trimesh.Trimesh([[0, 0, 50], [20, 0, 50], [20, 20, 50], [0, 20, 50]], [[0, 1, 2], [0, 2, 3]])
    return joined(bracket(), sheet)


@_defect
def loose_vertices() -> trimesh.Trimesh:
    mesh = bracket()
    return trimesh.Trimesh(np.concatenate([mesh.vertices, [[900, 0, 0], [0, -700, 3]]]), mesh.faces, process=False)


@_defect
def degenerate_faces() -> trimesh.Trimesh:
    mesh = bracket()
    return trimesh.Trimesh(mesh.vertices, np.concatenate([mesh.faces, [[0, 0, 1], [2, 2, 2]]]), process=False)


@_defect
def slivers() -> trimesh.Trimesh:
    """Each edge of one face is split a hair from its corner."""
    mesh = bracket()
    a, b, c = np.asarray(mesh.faces)[0]
    vertices = np.concatenate([mesh.vertices, [mesh.vertices[a] + 1e-7 * (mesh.vertices[b] - mesh.vertices[a])]])
    new = len(vertices) - 1
    faces = [face for k, face in enumerate(np.asarray(mesh.faces).tolist()) if k != 0]
    faces += [[a, new, c], [new, b, c]]
    other = next(face for face in faces if {a, b} <= set(face) and new not in face)
    faces.remove(other)
    third = next(v for v in other if v not in (a, b))
    faces += [[b, new, third], [new, a, third]]
    return trimesh.Trimesh(vertices, faces, process=False)


@_defect
def far_from_the_origin() -> trimesh.Trimesh:
    return bracket().apply_translation([1e6, -2e6, 3e5])


@_defect
def overlapping_bodies() -> trimesh.Trimesh:
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 40]).apply_translation([5, 10, 20])
    return joined(foot, leg)


@_defect
def overlapping_bodies_one_inward() -> trimesh.Trimesh:
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 40]).apply_translation([5, 10, 20])
    return soup(joined(flipped(foot, slice(0, 5)), leg))


@_defect
def touching_in_a_face() -> trimesh.Trimesh:
    foot = trimesh.creation.box([60, 20, 10]).apply_translation([30, 10, 5])
    leg = trimesh.creation.box([10, 20, 30]).apply_translation([5, 10, 25])
    return joined(foot, leg)


@_defect
def a_body_inside_another() -> trimesh.Trimesh:
    return joined(bracket(), trimesh.creation.box([20, 10, 5]).apply_translation([30, 10, 5]))


@_defect
def a_face_sheet_inside() -> trimesh.Trimesh:
    """A wall across the inside, as shells of unions leave it: its edges have three faces."""
    mesh = bracket()
    n = len(mesh.vertices)
    wall = np.array([[10, 0, 10], [10, 20, 10], [10, 20, 0], [10, 0, 0]], float)
    faces = np.concatenate([mesh.faces, [[n, n + 1, n + 2], [n, n + 2, n + 3]]])
    return trimesh.Trimesh(np.concatenate([mesh.vertices, wall]), faces, process=False)


@_defect
def many_seams() -> trimesh.Trimesh:
    """Each flat side is its own patch, as CAD kernels export it, and rims differ in the last digits."""
    mesh = bracket()
    patches = [only(mesh, facet) for facet in mesh.facets]
    rng = np.random.default_rng(1)
    return joined(*(patch.apply_translation(rng.normal(scale=1e-6, size=3)) for patch in patches))


@_defect
def noisy_scan() -> trimesh.Trimesh:
    mesh = bracket().subdivide().subdivide().subdivide()
    mesh.vertices = mesh.vertices + np.random.default_rng(2).normal(scale=0.05, size=mesh.vertices.shape)
    return mesh


@_defect
def single_precision_far_away() -> trimesh.Trimesh:
    mesh = bracket().apply_translation([2e3, 0, 0])
    return trimesh.Trimesh(np.asarray(mesh.vertices, np.float32).astype(float), mesh.faces, process=False)


@_defect
def t_junctions() -> trimesh.Trimesh:
    """One side's triangles are split along their edges, its neighbours' are not."""
    mesh = bracket()
    side = np.asarray(mesh.face_normals)[:, 1] > 0.9
    fine = only(mesh, np.flatnonzero(side)).subdivide()
    return joined(without(mesh, np.flatnonzero(side)), fine)


@_defect
def hole_of_many_edges() -> trimesh.Trimesh:
    mesh = bracket().subdivide().subdivide().subdivide().subdivide()
    centre = mesh.triangles_center[np.argmax(mesh.triangles_center[:, 0])]
    return without(mesh, np.flatnonzero(np.linalg.norm(mesh.triangles_center - centre, axis=1) < 3.0))


def crossing_itself() -> tuple[trimesh.Trimesh, float]:
    """Return a square bar bent into a flat figure of eight, one surface that passes through itself, and its volume."""
    angle = np.linspace(0, 2 * np.pi, 49)[:-1]
    path = np.stack([25 * np.sin(angle), 12 * np.sin(2 * angle), 0 * angle], axis=-1)
    along = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0)
    side = np.cross(along, [0, 0, 1.0])
    side *= 4 / np.linalg.norm(side, axis=1, keepdims=True)
    up = np.array([0, 0, 4.0])
    rings = np.stack([path + side + up, path - side + up, path - side - up, path + side - up], axis=1)
    n = len(path)
    faces = []
    for k in range(n):
        for j in range(4):
            a, b = 4 * k + j, 4 * k + (j + 1) % 4
            c, d = 4 * ((k + 1) % n) + (j + 1) % 4, 4 * ((k + 1) % n) + j
            faces += [[a, b, c], [a, c, d]]
    pieces = [trimesh.Trimesh(np.concatenate([rings[k], rings[(k + 1) % n]])).convex_hull for k in range(n)]
    return trimesh.Trimesh(rings.reshape(-1, 3), faces, process=False), float(trimesh.boolean.union(pieces).volume)


def _library_defects() -> None:
    def add(name: str, change: Callable[[trimesh.Trimesh], trimesh.Trimesh], part: str) -> None:
        BUILDERS[f"{part}_{name}"] = lambda: change(library_mesh(part))

    rng = np.random.default_rng(3)
    for part in ("hex_nut", "l_bracket", "hub_flange", "snap_clip"):
        add("soup", soup, part)
        add("off_by_1e_5", lambda mesh: jittered(mesh, 1e-5), part)
        add("one_face_missing", lambda mesh: without(mesh, [len(mesh.faces) // 2]), part)
        add("mixed_winding", lambda mesh: flipped(mesh, rng.random(len(mesh.faces)) < 0.3), part)
    add("every_hundredth_face_missing", lambda mesh: without(mesh, np.arange(0, len(mesh.faces), 100)), "crank_arm")
    add("in_doubles", lambda mesh: joined(mesh, mesh), "wing_nut")


_library_defects()
