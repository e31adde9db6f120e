"""Detection finds the known groups of known solids, wherever they lie and however they are turned."""

import numpy as np
import pytest
import trimesh

from simpick.assets.surface import SurfaceDistance
from simpick.assets.symmetry_detection import detect_symmetries
from simpick.geometry.transforms import random_rotation, transform

TETRAHEDRON = trimesh.Trimesh(
    0.02 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]), [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("solid", "rotations", "axes"),
    [
        (trimesh.creation.box([0.02, 0.03, 0.04]), 4, 0),
        (trimesh.creation.box([0.02, 0.02, 0.04]), 8, 0),
        (trimesh.creation.box([0.03, 0.03, 0.03]), 24, 0),
        (TETRAHEDRON, 12, 0),
        (trimesh.creation.cylinder(0.01, 0.03, sections=64), 2, 1),
        (trimesh.creation.cone(0.01, 0.03, sections=64), 1, 1),
    ],
    ids=["brick", "square bar", "cube", "tetrahedron", "cylinder", "cone"],
)
def test_known_solids(solid, rotations, axes, turned):
    mesh = solid.copy()
    if turned:
        mesh.apply_transform(transform(random_rotation(np.random.default_rng(1)), np.array([0.1, -0.2, 0.3])))
    group = detect_symmetries(mesh)
    assert (len(group.discrete) + 1, len(group.continuous)) == (rotations, axes)
    distance = SurfaceDistance(mesh)
    for T in group.transforms(8):
        assert distance(np.asarray(mesh.vertices) @ T[:3, :3].T + T[:3, 3]).max() < 3e-4


def test_a_sphere_has_an_element_near_every_rotation():
    group = detect_symmetries(trimesh.creation.icosphere(subdivisions=3, radius=0.02))
    errors_deg = np.degrees(group.rotation_distance(random_rotation(np.random.default_rng(0), (1000,)), np.eye(3)))
    assert errors_deg.max() < 11.0
    assert errors_deg.mean() < 6.5


def test_one_small_feature_breaks_a_symmetry():
    disc = trimesh.creation.cylinder(0.02, 0.01, sections=64)
    boss = trimesh.creation.cylinder(0.002, 0.014, sections=24).apply_translation([0.012, 0, 0])
    assert detect_symmetries(trimesh.boolean.union([disc, boss])).continuous == ()


def test_a_wider_tolerance_forgives_coarse_facets():
    coarse = trimesh.creation.cylinder(0.01, 0.03, sections=10)
    assert not detect_symmetries(coarse).continuous
    assert detect_symmetries(coarse, tolerance_m=1e-3).continuous
