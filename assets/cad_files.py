"""Reading a CAD file as it is: its triangles and, where the format states one, its unit."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from simpick.errors import MeshError

SUFFIXES = (".stl", ".obj", ".ply", ".glb", ".off", ".step", ".stp", ".3mf", ".dae")
"""File types that are read."""
MAX_BYTES = 300 * 2**20
"""Files beyond this size are not even read."""
_NEEDS = {".step": "cascadio", ".stp": "cascadio", ".3mf": "lxml", ".dae": "collada"}
"""Modules that a format needs beyond simpick's own dependencies."""
_UNIT_NAMES = {
    "millimeter": "mm", "millimeters": "mm", "mm": "mm", "centimeter": "cm", "centimeters": "cm", "cm": "cm",
    "meter": "m", "meters": "m", "m": "m", "inch": "inch", "inches": "inch", "in": "inch",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class CadFile:
    """The content of a CAD file."""

    mesh: trimesh.Trimesh
    """All triangles in one mesh, as they are in the file: open, doubled or unmerged."""
    unit: str | None
    """Unit that the file states for its coordinates, None if it states none."""


def load_file(path: Path) -> CadFile:
    """Return the file's triangles. Raises `MeshError` if it cannot be read or holds no finite triangles."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
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
    if suffix in _NEEDS and importlib.util.find_spec(_NEEDS[suffix]) is None:
        raise MeshError(
            f"{path.name}: reading {suffix} needs the package {_NEEDS[suffix]}. Install it with: "
            "pip install 'simpick[cad]', or export the part as STL."
        )
    try:
        # Which errors a broken file raises depends on its format and on trimesh; all of them mean the same here.
        scene = trimesh.load_scene(path, process=False)
        loaded = scene.to_mesh()
    except ModuleNotFoundError as error:
        # trimesh takes what does not begin as a binary file for text in a foreign encoding.
        raise MeshError(
            f"{path.name}: cannot be read as {suffix}: it is neither a whole binary file nor plain text, "
            "so truncated or damaged. Export it again from CAD."
        ) from error
    except Exception as error:
        raise MeshError(
            f"{path.name}: cannot be read as {suffix} ({type(error).__name__}: {error}). "
            "Open it in a mesh viewer to check it, or export it again from CAD."
        ) from error
    if len(loaded.faces) == 0:
        raise MeshError(f"{path.name}: holds no faces. Export a solid or surface mesh, not points or curves.")
    mesh = trimesh.Trimesh(np.asarray(loaded.vertices, float), np.asarray(loaded.faces), process=False)
    _check_numbers(mesh, path)
    if suffix in (".step", ".stp"):
        # The converter writes metres, whatever the file's own unit; CAD systems show millimetres.
        mesh.apply_scale(1e3)
        return CadFile(mesh, "mm")
    return CadFile(mesh, _UNIT_NAMES.get(str(scene.units).lower()) if suffix in (".3mf", ".dae") else None)


def _check_numbers(mesh: trimesh.Trimesh, path: Path) -> None:
    vertices = np.asarray(mesh.vertices)
    bad = ~np.isfinite(vertices).all(axis=1) | (np.abs(np.nan_to_num(vertices)).max(axis=1) > 1e12)
    if bad.any():
        raise MeshError(
            f"{path.name}: {int(bad.sum())} of {bad.size} vertices are NaN or infinite. Export it again from CAD."
        )
