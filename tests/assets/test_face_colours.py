"""Colours of mesh files: read from vertices and textures, and rendered face by face."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals

from simpick.assets import get_part
from simpick.assets.face_colours import vertex_colours, with_file_colours
from simpick.geometry import Pinhole, so3_exp, transform
from simpick.rendering import PartRenderer

CAMERA = Pinhole(80, 80, 200.0, 200.0, 40.0, 40.0)


def half_and_half() -> trimesh.Trimesh:
    """Return a block in millimetres, far from the origin, that is red where x is large and blue elsewhere."""
    mesh = trimesh.creation.box((40, 30, 20)).subdivide().subdivide()
    colours = np.where(mesh.vertices[:, :1] > 0, [[220, 20, 20, 255]], [[20, 20, 220, 255]]).astype(np.uint8)
    mesh.visual = ColorVisuals(mesh, vertex_colors=colours)
    mesh.apply_translation([500, -300, 100])
    return mesh


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".obj"])
def test_a_files_colours_are_rendered_where_they_are(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"block{suffix}"
    half_and_half().export(path)
    part = with_file_colours(get_part(path), path)
    assert part.face_rgb is not None and part.content_hash != get_part(path).content_hash
    # Seen from +z, with the part's x to the right of the image.
    T = transform(so3_exp(np.array([np.pi, 0, 0])), np.array([0.0, 0, 0.2]))
    with PartRenderer(part, 80, 80) as renderer:
        views = renderer.render(T[None], CAMERA)
    assert views.rgb is not None
    left, right = views.rgb[0, 40, 25].astype(int), views.rgb[0, 40, 55].astype(int)
    assert left[2] > 3 * left[0] and right[0] > 3 * right[2]


def test_textures_are_read_at_the_vertices() -> None:
    mesh = trimesh.creation.box((40, 30, 20))
    image = np.zeros((2, 2, 3), np.uint8)
    image[:, 1] = 200
    uv = np.stack([(mesh.vertices[:, 0] > 0) * 0.98 + 0.01, np.full(8, 0.5)], axis=1)
    mesh.visual = TextureVisuals(uv=uv, image=Image.fromarray(image))
    colours = vertex_colours(mesh)
    assert colours is not None
    assert (colours[mesh.vertices[:, 0] > 0] == 200).all() and (colours[mesh.vertices[:, 0] < 0] == 0).all()


def test_files_of_one_colour_and_without_colours_keep_the_material(tmp_path: Path) -> None:
    plain = trimesh.creation.box((40, 30, 20))
    assert vertex_colours(plain) is None
    plain.visual = ColorVisuals(plain, vertex_colors=np.full((8, 4), 90, np.uint8))
    assert vertex_colours(plain) is None
    plain.export(tmp_path / "plain.stl")
    part = get_part(tmp_path / "plain.stl")
    assert with_file_colours(part, tmp_path / "plain.stl") is part
