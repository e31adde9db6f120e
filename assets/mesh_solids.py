"""From a cleaned mesh to one closed solid: holes, winding, sheets, several bodies, surfaces that cross themselves.

Every repair is reported with how far it moved the surface. What encloses no volume raises `OpenMeshError`, which holds
the open edges, so that they can be drawn.
"""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float, Int
from manifold3d import Error, Manifold

from simpick.assets.csg import cut, to_manifold, to_trimesh, union
from simpick.assets.mesh_cleaning import open_edges
from simpick.assets.surface import SurfaceDistance
from simpick.assets.voxel_wrap import wrapped
from simpick.assets.winding import misplaced_share
from simpick.errors import MeshError, OpenMeshError

_LARGEST_FILL = 0.06
"""Holes are filled by flat fans while those add less than this share of the surface."""
_SHORT_RIM = 4
"""Holes of so few edges are always filled: one or two missing faces."""
_FLAT = 1e-3
_LEAST_AREA = 1e-9
"""A surface has at least this share of its bounding square."""
_LEAST_VOLUME = 1e-6
"""A solid holds at least this share of its bounding cube."""
_OVERLAP = 0.01
"""Share of the volume that may lie inside the surface twice, or inside out, before the surface is replaced."""


def solidified(
    mesh: trimesh.Trimesh, file: str, *, thickness_m: float = 0.0, body: int = 0
) -> tuple[trimesh.Trimesh, list[str]]:
    """Return a closed mesh (in metres) that faces outward, and notes on what was repaired.

    Sheets get `thickness_m` if that is positive. `body` chooses one of several bodies by size, 1 being the largest;
    0 takes all as one rigid part. Raises `OpenMeshError` for what encloses no volume, else `MeshError`.
    """
    notes: list[str] = []
    if mesh.area <= _LEAST_AREA * float(mesh.extents.max()) ** 2:
        raise OpenMeshError(
            f"{file}: has no surface: the corners of each triangle lie on a line. Export it again from CAD as a solid.",
            mesh,
        )
    if thickness_m > 0 and open_edges(mesh):
        mesh = _thickened(mesh, thickness_m, file, notes)
    _check_not_flat(mesh, file)
    mesh = _closed(mesh, file, notes)
    mesh = _one_of(_oriented_bodies(mesh, file, notes), body, file, notes)
    if misplaced_share(mesh) > _OVERLAP:
        mesh = _wrapped(mesh, file, notes, "its surface crosses itself")
    size = float(mesh.extents.max())
    if mesh.volume < _LEAST_VOLUME * size**3:
        raise OpenMeshError(f"{file}: is closed, but encloses no volume. Export it again from CAD as a solid.", mesh)
    return mesh, notes


def is_sound(mesh: trimesh.Trimesh) -> bool:
    """Return whether the mesh is closed, wound consistently, and accepted by the solid modeller."""
    if len(mesh.faces) < 4 or not (mesh.is_watertight and mesh.is_winding_consistent):
        return False
    solid = to_manifold(mesh)
    return solid.status() == Error.NoError and not solid.is_empty()


def _check_not_flat(mesh: trimesh.Trimesh, file: str) -> None:
    extents = np.sort(mesh.extents)
    if extents[0] < _FLAT * extents[2]:
        raise OpenMeshError(
            f"{file}: is flat: its thinnest side is {extents[0] * 1e3:.3g} mm where its longest is "
            f"{extents[2] * 1e3:.3g} mm, and must be at least a thousandth of it. If it is a sheet, give its "
            "thickness (--thickness, in m), or give the surface a thickness in CAD.",
            mesh,
        )


def _closed(mesh: trimesh.Trimesh, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return a sound mesh, repaired by the mildest means that makes it sound."""
    if is_sound(mesh):
        return mesh
    wound = mesh.copy()
    trimesh.repair.fix_winding(wound)
    if is_sound(wound):
        notes.append(f"{file}: made the faces' winding consistent")
        return wound
    count = open_edges(wound)
    if not count:
        solid = to_manifold(wound)
        if solid.status() == Error.NoError and not solid.is_empty():
            notes.append(f"{file}: has edges with more than two faces, where bodies touch; split there")
            return to_trimesh(solid)
    filled, longest = _filled(wound)
    added = float(filled.area) / float(wound.area) - 1
    if (longest <= _SHORT_RIM or added < _LARGEST_FILL) and is_sound(filled):
        notes.append(f"{file}: closed small holes ({count} open edges, {added:.2%} of the surface added)")
        return filled
    return _wrapped(mesh, file, notes, f"{count} of {len(mesh.edges_unique)} edges are open")


def _filled(mesh: trimesh.Trimesh) -> tuple[trimesh.Trimesh, int]:
    """Return the mesh with each rim closed, by a triangle or a fan about the mean of its vertices; the longest rim."""
    once = trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)
    following: dict[int, list[int]] = {}
    normal_at: dict[tuple[int, int], Float[np.ndarray, "3"]] = {}
    for (start, end), face in zip(np.asarray(mesh.edges)[once].tolist(), mesh.edges_face[once], strict=True):
        following.setdefault(start, []).append(end)
        normal_at[start, end] = np.asarray(mesh.face_normals)[face]
    vertices, faces = np.asarray(mesh.vertices), [np.asarray(mesh.faces)]
    longest = 0
    while following:
        ring = [next(iter(following))]
        while (ends := following.get(ring[-1])) is not None:
            ring.append(ends.pop())
            if not ends:
                del following[ring[-2]]
            if ring[-1] in ring[:-1]:
                break
        ring = ring[ring.index(ring[-1]) : -1]
        longest = max(longest, len(ring))
        if len(ring) == 3:
            faces.append(np.array([ring[::-1]]))
        elif len(ring) == 4:
            normals = np.stack([normal_at[pair] for pair in zip(ring, [*ring[1:], ring[0]], strict=True)])
            faces.append(_quad(vertices, ring, normals))
        elif len(ring) > 3:
            faces.append(np.c_[np.roll(ring, -1), ring, np.full(len(ring), len(vertices))])
            vertices = np.concatenate([vertices, vertices[ring].mean(axis=0)[None]])
    return trimesh.Trimesh(vertices, np.concatenate(faces), process=False), longest


def _quad(
    vertices: Float[np.ndarray, "n 3"], ring: list[int], normals: Float[np.ndarray, "4 3"]
) -> Int[np.ndarray, "2 3"]:
    """Return two triangles in a rim of four edges, split so that they continue the faces beside those edges."""
    a, b, c, d = ring
    splits = np.array([[[c, b, a], [d, c, a]], [[b, a, d], [d, c, b]]])
    beside = np.array([[[0, 1], [2, 3]], [[3, 0], [1, 2]]])
    corners = vertices[splits]
    facing = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] - corners[..., 0, :])
    facing /= np.maximum(np.linalg.norm(facing, axis=-1, keepdims=True), 1e-300)
    return splits[np.argmax(np.einsum("sti,stei->s", facing, normals[beside]))]


def _wrapped(mesh: trimesh.Trimesh, file: str, notes: list[str], reason: str) -> trimesh.Trimesh:
    """Return the surface that a grid sees from outside: the last resort."""
    found = wrapped(mesh)
    if found is None:
        raise OpenMeshError(
            f"{file}: encloses no volume: {reason}. A part needs one: export it as a solid, close it in a mesh editor "
            "(MeshLab: Filters, Remeshing, Close Holes; Blender: Mesh, Clean Up, Fill Holes), or, if it is a sheet, "
            "give its thickness (--thickness, in m). To see where: simpick parts check FILE",
            mesh,
        )
    moved = _moved_m(mesh, found)
    notes.append(
        f"{file}: {reason}; replaced by a wrap of {len(found.faces)} faces that lies within {moved * 1e3:.2g} mm of "
        "the surface (99 % of it). Small holes and inner surfaces are gone; export a clean solid where they matter"
    )
    return found


def _moved_m(before: trimesh.Trimesh, after: trimesh.Trimesh) -> float:
    """Return the distance within which 99 % of the new surface lie from the old one."""
    points = trimesh.sample.sample_surface(after, 1000, seed=0)[0]
    return float(np.quantile(SurfaceDistance(before)(np.asarray(points, float)), 0.99))


def _thickened(mesh: trimesh.Trimesh, thickness_m: float, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return the sheet as a solid: both sides at half the thickness along the vertex normals, walls at its rims."""
    sheet = mesh.copy()
    trimesh.repair.fix_winding(sheet)
    vertices, faces = np.asarray(sheet.vertices), np.asarray(sheet.faces)
    step = 0.5 * thickness_m * np.asarray(sheet.vertex_normals)
    rim = np.asarray(sheet.edges)[trimesh.grouping.group_rows(sheet.edges_sorted, require_count=1)]
    n = len(vertices)
    walls = np.concatenate([np.c_[rim[:, ::-1], rim[:, 0] + n], np.c_[rim[:, 1], rim + n]])
    solid = trimesh.Trimesh(
        np.concatenate([vertices + step, vertices - step]), np.concatenate([faces, faces[:, ::-1] + n, walls]),
        process=False,
    )  # fmt: skip
    notes.append(f"{file}: a sheet, thickened to {thickness_m * 1e3:.3g} mm")
    return solid


def _oriented_bodies(mesh: trimesh.Trimesh, file: str, notes: list[str]) -> list[Manifold]:
    """Return the mesh's bodies as solids with their cavities, largest first."""
    shells = [to_manifold(shell) for shell in mesh.split(only_watertight=True, repair=False)] or [to_manifold(mesh)]
    least = 1e-9 * max(abs(shell.volume()) for shell in shells)
    shells = [shell for shell in shells if abs(shell.volume()) > least]
    if not shells:
        raise OpenMeshError(f"{file}: is closed, but encloses no volume. Export it again from CAD as a solid.", mesh)
    inward = [shell.volume() < 0 for shell in shells]
    shells = [_inverted(shell) if flip else shell for shell, flip in zip(shells, inward, strict=True)]
    order = sorted(range(len(shells)), key=lambda k: -shells[k].volume())
    solids: list[Manifold] = []
    cavities: list[Manifold] = []
    turned = 0
    for rank, k in enumerate(order):
        # A cavity lies wholly inside a larger shell and faces the other way.
        around = [j for j in order[:rank] if _lies_inside(shells[k], shells[j])]
        if around and inward[around[-1]] != inward[k]:
            cavities.append(shells[k])
        else:
            solids.append(shells[k])
            turned += inward[k]
    if turned:
        notes.append(f"{file}: faces pointed inward and were flipped")
    if len(shells) == 1:
        return solids
    filled = union(*solids)
    if cavities:
        filled = cut(filled, *cavities)
        notes.append(f"{file}: {len(cavities)} closed cavities inside")
    shells = filled.decompose()
    holes = [_inverted(shell) for shell in shells if shell.volume() < -least]
    bodies = [shell for shell in shells if shell.volume() > least]
    bodies = [cut(body, *[hole for hole in holes if _lies_inside(hole, body)]) for body in bodies]
    bodies.sort(key=lambda body: -body.volume())
    if len(solids) > len(bodies):
        notes.append(f"{file}: {len(solids)} closed surfaces overlap or touch and were united")
    return bodies


def _lies_inside(shell: Manifold, other: Manifold) -> bool:
    low, high = np.array(shell.bounding_box()).reshape(2, 3)
    other_low, other_high = np.array(other.bounding_box()).reshape(2, 3)
    if (low < other_low).any() or (high > other_high).any():
        return False
    return (shell - other).volume() < 1e-6 * shell.volume()


def _one_of(bodies: list[Manifold], body: int, file: str, notes: list[str]) -> trimesh.Trimesh:
    """Return the chosen body, or all of them."""
    if body > len(bodies):
        raise MeshError(f"{file}: body must be between 1 and {len(bodies)} (or 0 for all as one part), got {body}")
    if len(bodies) > 1:
        volumes = ", ".join(f"{100 * b.volume() / sum(b.volume() for b in bodies):.0f} %" for b in bodies[:6])
        chosen = f"body {body} is taken" if body else "taken as one rigid part; --body 1 takes the largest alone"
        notes.append(f"{file}: holds {len(bodies)} bodies that do not touch ({volumes} of the volume): {chosen}")
    return to_trimesh(bodies[body - 1] if body else union(*bodies))


def _inverted(solid: Manifold) -> Manifold:
    mesh = to_trimesh(solid)
    return to_manifold(trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[:, ::-1], process=False))
