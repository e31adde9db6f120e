"""Reading a CAD file into one closed mesh, in the file's own unit and frame, or saying why that is not possible."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from simpick.assets.csg import cut, to_manifold, to_trimesh, union
from simpick.errors import MeshError

SUFFIXES = (".stl", ".obj", ".ply", ".glb")
"""File types that are read."""
MAX_FACES = 200_000
"""More than this slows every rendering and is never needed to recognise a part."""
MAX_BYTES = 300 * 2**20
"""Files beyond this size are not even read."""
_SIMPLIFY = 1e-3


def read_cad(path: Path, *, simplify: bool = False) -> tuple[trimesh.Trimesh, list[str]]:
    """Return the file's mesh, watertight and facing outward, and notes on what was repaired.

    Small faults are repaired: unmerged vertices, degenerate and double faces, holes of three or four edges,
    inverted winding, bodies that overlap. `simplify` merges facets within 0.1 % of the size. Raises `MeshError`.
    """
    mesh = _load(path)
    _check_numbers(mesh, path)
    notes: list[str] = []
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise MeshError(f"{path.name}: every face is degenerate (no area). Export it again from CAD as a solid.")
    if len(mesh.faces) > MAX_FACES and not simplify:
        raise MeshError(
            f"{path.name}: must have at most {MAX_FACES} faces, got {len(mesh.faces)}. Export it with a coarser "
            "tolerance, or simplify it while reading (--simplify, or simplify=True)."
        )
    _check_not_flat(mesh, path)
    _close(mesh, path, notes)
    if mesh.volume < 0:
        mesh.invert()
        notes.append(f"{path.name}: faces pointed inward and were flipped")
    mesh = _united(mesh, path, notes)
    if simplify:
        before = len(mesh.faces)
        mesh = to_trimesh(to_manifold(mesh).simplify(_SIMPLIFY * float(mesh.extents.max())))
        notes.append(f"{path.name}: simplified from {before} to {len(mesh.faces)} faces")
        if len(mesh.faces) > MAX_FACES:
            raise MeshError(
                f"{path.name}: still has {len(mesh.faces)} faces after simplification, must have at most {MAX_FACES}. "
                "Export it with a coarser tolerance."
            )
    return mesh, notes


def _load(path: Path) -> trimesh.Trimesh:
    if path.suffix.lower() not in SUFFIXES:
        raise MeshError(f"{path.name}: file type must be one of {', '.join(SUFFIXES)}, got {path.suffix or 'none'!r}")
    if not path.is_file():
        raise MeshError(f"no mesh file at {path}. Check the path.")
    size = path.stat().st_size
    if size == 0:
        raise MeshError(f"{path.name}: the file is empty (0 bytes). Export it again from CAD.")
    if size > MAX_BYTES:
        raise MeshError(
            f"{path.name}: must be at most {MAX_BYTES >> 20} MiB, got {size >> 20} MiB. "
            "Export it with a coarser tolerance."
        )
    try:
        # Which errors a broken file raises depends on its format and on trimesh; all of them mean the same here.
        loaded = trimesh.load_scene(path, process=False).to_mesh()
    except ModuleNotFoundError as error:
        # trimesh takes what does not begin as a binary file for text in a foreign encoding.
        raise MeshError(
            f"{path.name}: cannot be read as {path.suffix.lower()}: it is neither a whole binary file nor plain text, "
            "so truncated or damaged. Export it again from CAD."
        ) from error
    except Exception as error:
        raise MeshError(
            f"{path.name}: cannot be read as {path.suffix.lower()} ({type(error).__name__}: {error}). "
            "Open it in a mesh viewer to check it, or export it again from CAD."
        ) from error
    if len(loaded.faces) == 0:
        raise MeshError(f"{path.name}: holds no faces. Export a solid or surface mesh, not points or curves.")
    return trimesh.Trimesh(np.asarray(loaded.vertices), np.asarray(loaded.faces), process=False)


def _check_numbers(mesh: trimesh.Trimesh, path: Path) -> None:
    bad = np.asarray(~np.isfinite(mesh.vertices).all(axis=1))
    if bad.any():
        raise MeshError(
            f"{path.name}: {int(bad.sum())} of {bad.size} vertices are NaN or infinite. Export it again from CAD."
        )


def _check_not_flat(mesh: trimesh.Trimesh, path: Path) -> None:
    extents = np.sort(mesh.extents)
    if extents[0] < 1e-3 * extents[2]:
        raise MeshError(
            f"{path.name}: is flat: its thinnest side is {extents[0]:.3g} where its longest is {extents[2]:.3g} "
            "(file units), and must be at least a thousandth of it. Give the surface a thickness in CAD."
        )


def _close(mesh: trimesh.Trimesh, path: Path, notes: list[str]) -> None:
    if not mesh.is_watertight:
        before = _open_edges(mesh)
        mesh.fill_holes()
        mesh.fix_normals()
        if mesh.is_watertight:
            notes.append(f"{path.name}: closed small holes ({before} open edges)")
    elif not mesh.is_winding_consistent:
        mesh.fix_normals()
        notes.append(f"{path.name}: made the faces' winding consistent")
    if not mesh.is_watertight:
        raise MeshError(
            f"{path.name}: is not watertight: {_open_edges(mesh)} open edges of {len(mesh.edges_unique)} remain after "
            "closing small holes. A part needs a volume: export it as a solid, or close it in a mesh editor "
            "(MeshLab: Filters, Remeshing, Close Holes; Blender: Mesh, Clean Up, Fill Holes)."
        )


def _open_edges(mesh: trimesh.Trimesh) -> int:
    """Return how many edges do not lie between exactly two faces."""
    counts = np.bincount(mesh.edges_unique_inverse)
    return int((counts != 2).sum())


def _united(mesh: trimesh.Trimesh, path: Path, notes: list[str]) -> trimesh.Trimesh:
    """Return the union of a file's bodies, so that volume and mass count each place once."""
    bodies = mesh.split(only_watertight=True)
    if len(bodies) < 2:
        return mesh
    solids = [(to_manifold(body), float(body.volume)) for body in bodies]
    if any(solid.is_empty() for solid, _ in solids):
        raise MeshError(f"{path.name}: its {len(bodies)} bodies cannot be united. Unite them in CAD, export one solid.")
    # A body that faces inward is a cavity in another.
    filled = union(*[solid for solid, volume in solids if volume > 0])
    cavities = [to_manifold(_inverted(body)) for body, (_, volume) in zip(bodies, solids, strict=True) if volume < 0]
    notes.append(f"{path.name}: {len(bodies)} closed surfaces taken as one rigid part")
    return to_trimesh(cut(filled, *cavities) if cavities else filled)


def _inverted(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    return trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[:, ::-1], process=False)
