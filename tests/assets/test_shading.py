"""Shading normals: smooth round a cylinder, sharp at a cube's edges, and MuJoCo takes them as they are."""

import mujoco
import numpy as np
import trimesh

from simpick.assets.library import get_part
from simpick.assets.mjcf import add_part
from simpick.assets.shading import split_at_creases


def test_a_cube_has_three_normals_at_each_corner():
    vertices, normals, _ = split_at_creases(trimesh.creation.box([1, 1, 1]))
    assert len(vertices) == 24
    assert np.allclose(np.abs(normals).max(axis=1), 1.0)


def test_a_cylinders_side_is_smooth():
    vertices, normals, _ = split_at_creases(trimesh.creation.cylinder(1.0, 2.0, sections=24))
    side = np.abs(normals[:, 2]) < 0.5
    radial = vertices[side] * [1, 1, 0]
    assert side.sum() == 48
    assert np.allclose(normals[side], radial, atol=1e-6)


def test_compiled_normals_belong_to_their_faces():
    part, spec = get_part("hinge_leaf"), mujoco.MjSpec()
    add_part(spec, part, "p", collide=False)
    model = spec.compile()
    corners = model.mesh_vert[model.mesh_face]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cosines = (model.mesh_normal[model.mesh_facenormal] * normals[:, None]).sum(-1)
    assert cosines.min() > np.cos(np.radians(35.0))
