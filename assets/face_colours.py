"""Colours of a mesh file's faces: from its vertex colours, or from its texture at its vertices."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import UInt8
from scipy.spatial import KDTree
from trimesh.visual.texture import TextureVisuals

from simpick.assets.part import Part
from simpick.geometry.transforms import transform_points

_LEAST_SPREAD = 8
"""Meshes whose colours vary less than this about their mean, in levels of 255, count as of one colour."""


def vertex_colours(mesh: trimesh.Trimesh) -> UInt8[np.ndarray, "vertices 3"] | None:
    """Return the colour of each vertex; None where the file has none, or only one."""
    visual = mesh.visual
    try:
        if isinstance(visual, TextureVisuals):
            visual = visual.to_color()
        rgba = np.asarray(visual.vertex_colors) if visual is not None and visual.defined else np.zeros((0, 4))
    except (AttributeError, ValueError, IndexError):  # Texture coordinates without their image.
        return None
    if rgba.shape != (len(mesh.vertices), 4) or rgba[:, :3].std(axis=0).max() < _LEAST_SPREAD:
        return None
    return np.ascontiguousarray(rgba[:, :3], np.uint8)


def face_colours(mesh: trimesh.Trimesh, colours: UInt8[np.ndarray, "vertices 3"]) -> UInt8[np.ndarray, "faces 3"]:
    """Return each face's mean colour."""
    return np.rint(colours[np.asarray(mesh.faces)].mean(axis=1)).astype(np.uint8)


def with_file_colours(part: Part, path: Path) -> Part:
    """Return a part of a mesh file with the colours of that file, or the part itself where it has none.

    Import may repair and change the mesh, so each face takes the colour of the file's nearest vertex.
    """
    try:
        source = trimesh.load_scene(path, process=False).to_mesh()
    except Exception:  # The importer read it in another way, and reports what is wrong with files.
        return part
    colours = vertex_colours(source)
    if colours is None:
        return part
    centres_m = transform_points(part.T_cad_part, np.asarray(part.mesh.triangles_center))
    nearest = KDTree(np.asarray(source.vertices)).query(centres_m / part.metres_per_cad_unit)[1]
    return replace(part, face_rgb=colours[nearest])
