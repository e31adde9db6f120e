"""The PLY files of BOP's object models."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from simpick.errors import DatasetError


def read_ply(path: Path, present: str) -> trimesh.Trimesh:
    """Return a mesh in the file's own unit and frame, vertices in the file's order."""
    if not path.is_file():
        raise DatasetError(
            f"no mesh {path}, though models_info.json or the images name this object. Meshes there: {present}. Fetch "
            "the data set's models, or point to their folder."
        )
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:
        raise DatasetError(f"{path}: not a readable PLY mesh ({error}); fetch it again.") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.vertices) == 0 or len(mesh.faces) == 0:
        raise DatasetError(f"{path}: has no triangles; simpick needs a mesh, not a point cloud.")
    if not np.isfinite(mesh.vertices).all():
        raise DatasetError(f"{path}: has vertices that are not finite; check the model.")
    if not (mesh.faces.min() >= 0 and mesh.faces.max() < len(mesh.vertices)):
        raise DatasetError(f"{path}: has faces of vertices that it lacks; the file is damaged, fetch it again.")
    return mesh


def ply_text(vertices_mm: Float[np.ndarray, "n 3"], mesh: trimesh.Trimesh, rgb: tuple[float, float, float]) -> str:
    """Return the text of an ASCII PLY with normals and one colour, as in BOP's models.

    `mesh` provides faces and normals in the same frame. Coordinates are written as ``double`` in full precision, so
    that reading them back is exact.
    """
    n, m = len(vertices_mm), len(mesh.faces)
    red, green, blue = (round(255 * min(max(channel, 0.0), 1.0)) for channel in rgb)
    header = ["ply", "format ascii 1.0", "comment written by simpick, in millimetres", f"element vertex {n}"]
    header += [f"property double {name}" for name in ("x", "y", "z")] + [
        f"property float {name}" for name in ("nx", "ny", "nz")
    ]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header += [f"element face {m}", "property list uchar int vertex_indices", "end_header"]
    colour = f"{red} {green} {blue}"
    rows = [
        f"{x!r} {y!r} {z!r} {nx:.6f} {ny:.6f} {nz:.6f} {colour}"
        for (x, y, z), (nx, ny, nz) in zip(vertices_mm.tolist(), mesh.vertex_normals.tolist(), strict=True)
    ]
    faces = [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
    return "\n".join([*header, *rows, *faces]) + "\n"
