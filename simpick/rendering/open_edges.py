"""A picture of where a mesh is open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from simpick.assets.mesh_cleaning import open_edge_lines
from simpick.plotting import new_figure, save_figure

_MOST_FACES = 20_000
_VIEWS_DEG = ((25.0, -60.0), (-25.0, 120.0))


def draw_open_edges(mesh: trimesh.Trimesh, file: Path) -> None:
    """Write a picture of the mesh from two opposite sides, faces grey and open edges red; raises `OutputError`."""
    vertices = (np.asarray(mesh.vertices) - mesh.bounds.mean(axis=0)) * 1e3
    faces = np.asarray(mesh.faces)[:: len(mesh.faces) // _MOST_FACES + 1]
    edges = (open_edge_lines(mesh) - mesh.bounds.mean(axis=0)) * 1e3
    # A gap after each edge keeps one line from running on to the next.
    lines = np.concatenate([edges, np.full((len(edges), 1, 3), np.nan)], axis=1).reshape(-1, 3)
    half = 0.5 * float(mesh.extents.max()) * 1e3
    figure = new_figure(9.0, 4.5)
    for k, (elevation, azimuth) in enumerate(_VIEWS_DEG):
        axes = figure.add_subplot(1, 2, k + 1, projection="3d", elev=elevation, azim=azimuth)
        axes.plot_trisurf(*vertices.T, triangles=faces, color="0.8", edgecolor="0.6", linewidth=0.2, alpha=0.6)
        axes.plot(*lines.T, color="red", linewidth=1.5)
        axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(-half, half))
        axes.set(xlabel="x, mm", ylabel="y, mm", zlabel="z, mm")
        axes.set_box_aspect((1, 1, 1))
    figure.suptitle(f"{len(edges)} open edges")
    save_figure(figure, file)
