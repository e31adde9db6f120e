"""Surface sampling by area, and farthest points."""

import numpy as np
import pytest
import trimesh

from simpick.errors import ConfigError, MeshError
from simpick.geometry import farthest_points, sample_surface

BOX = trimesh.creation.box((0.1, 0.2, 0.4))


def sample(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    return sample_surface(BOX.vertices, BOX.faces, count, np.random.default_rng(seed))


def test_points_lie_on_the_surface_with_outward_normals() -> None:
    points, normals = sample(500)
    assert (np.abs(np.abs(points) / [0.05, 0.1, 0.2] - 1).min(-1) < 1e-9).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1)
    assert ((points * normals).sum(-1) > 0).all()


def test_faces_are_hit_by_area() -> None:
    points, normals = sample(20000)
    # Areas of the sides normal to x, y, z: 0.08, 0.04, 0.02 twice each.
    shares = np.abs(normals).round().mean(0)
    np.testing.assert_allclose(shares, np.array([0.08, 0.04, 0.02]) / 0.14, atol=0.01)
    np.testing.assert_allclose(points.mean(0), 0, atol=0.005)


def test_points_are_uniform_inside_a_triangle() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    points, _ = sample_surface(vertices, np.array([[0, 1, 2]]), 20000, np.random.default_rng(0))
    np.testing.assert_allclose(points.mean(0), [1 / 3, 1 / 3, 0], atol=0.01)
    # A quarter of the area lies in the corner triangle of half the side.
    assert (points.sum(-1) < 0.5).mean() == pytest.approx(0.25, abs=0.01)


def test_the_same_generator_gives_the_same_points() -> None:
    np.testing.assert_array_equal(sample(50, 7)[0], sample(50, 7)[0])
    assert not np.array_equal(sample(50, 7)[0], sample(50, 8)[0])


def test_faces_without_area_are_never_drawn() -> None:
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]])
    faces = np.array([[0, 1, 3], [0, 1, 2], [0, 0, 0]])
    points, normals = sample_surface(vertices, faces, 200, np.random.default_rng(0))
    np.testing.assert_array_equal(normals, np.tile([0.0, 0, 1], (200, 1)))
    assert (points.sum(-1) <= 1 + 1e-12).all()


@pytest.mark.parametrize("vertices", [np.zeros((3, 3)), np.full((3, 3), np.nan)], ids=["flat", "nan"])
def test_meshes_without_area_are_refused(vertices: np.ndarray) -> None:
    with pytest.raises(MeshError, match="finite vertices and a face that has an area; repair the mesh"):
        sample_surface(vertices, np.array([[0, 1, 2]]), 10, np.random.default_rng(0))


def test_farthest_points_of_a_box_are_its_corners() -> None:
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1])).reshape(3, -1).T
    points = np.concatenate([rng.uniform(-0.5, 0.5, (100, 3)), corners])
    assert set(farthest_points(points, 8)) == set(range(100, 108))


def test_all_points_are_chosen_once() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert sorted(farthest_points(points, 20)) == list(range(20))


@pytest.mark.parametrize("count", [0, 4])
def test_farthest_points_count_is_checked(count: int) -> None:
    with pytest.raises(ConfigError, match=f"between 1 and 3, got {count}"):
        farthest_points(np.eye(3), count)
