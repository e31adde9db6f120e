"""Library parts are valid solids, with exactly the symmetries they claim and collision pieces close to their shape."""

import subprocess
import sys

import mujoco
import numpy as np
import pytest
import trimesh

from simpick.assets import get_part, library_part_names, part_names
from simpick.assets.csg import to_manifold, union
from simpick.assets.mjcf import add_part
from simpick.assets.random_parts import random_part
from simpick.assets.surface import SurfaceDistance
from simpick.assets.symmetry_detection import detect_symmetries
from simpick.errors import ConfigError
from simpick.geometry.transforms import random_rotation, rotation_angle

NAMES = library_part_names()


def surface_points(mesh: trimesh.Trimesh, count: int) -> np.ndarray:
    return np.asarray(trimesh.sample.sample_surface(mesh, count, seed=7)[0])


def union_of(part):
    solid = union(*[to_manifold(piece) for piece in part.collision])
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts, int), process=False)


def test_there_are_at_least_sixteen_parts_and_most_have_no_symmetry_or_a_discrete_one():
    groups = [get_part(name).symmetries for name in NAMES]
    assert len(NAMES) >= 16
    assert sum(bool(group.continuous) for group in groups) >= 2
    assert sum(group.is_trivial for group in groups) >= 8


@pytest.mark.parametrize("name", NAMES)
def test_part_is_one_watertight_solid_of_a_size_and_mass_that_can_be_picked(name):
    part = get_part(name)
    assert part.mesh.is_watertight and part.mesh.is_winding_consistent
    assert part.mesh.body_count == 1
    assert 0.03 <= part.extents_m.max() <= 0.09
    assert part.extents_m.min() <= 0.075, "the jaw must close on it somewhere"
    assert 0.010 <= part.mass_kg <= 0.150


@pytest.mark.parametrize("name", NAMES)
def test_every_claimed_symmetry_maps_the_surface_onto_itself(name):
    part = get_part(name)
    distance, points = SurfaceDistance(part.mesh), surface_points(part.mesh, 60)
    # A turn by less than a facet leaves a revolution's surface by its facets' sag, anything else by rounding alone.
    limit_m = part.diameter_m / 2 * (1 - np.cos(np.pi / 48)) if part.symmetries.continuous else 1e-9
    for T in part.symmetries.transforms(11):
        assert distance(points @ T[:3, :3].T + T[:3, 3]).max() <= limit_m


@pytest.mark.parametrize("name", NAMES)
def test_detection_finds_the_claimed_symmetries_and_no_more(name):
    part = get_part(name)
    found = detect_symmetries(part.mesh)
    assert len(found.discrete) == len(part.symmetries.discrete)
    assert len(found.continuous) == len(part.symmetries.continuous)
    if not part.symmetries.continuous:
        for T in part.symmetries.discrete:
            assert rotation_angle(found.discrete[:, :3, :3] @ T[:3, :3].T).min() < np.radians(1.0)


@pytest.mark.parametrize("name", ["hex_nut", "bushing", "z_bracket"])
def test_a_rotation_outside_the_group_moves_the_surface(name):
    part, rng = get_part(name), np.random.default_rng(3)
    distance, points = SurfaceDistance(part.mesh), surface_points(part.mesh, 200)
    for R in random_rotation(rng, (10,)):
        assert distance(points @ R.T).max() > 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_collision_pieces_are_few_convex_thick_and_stand_for_the_mesh(name):
    part = get_part(name)
    assert len(part.collision) <= 12
    for piece in part.collision:
        assert piece.is_watertight
        assert piece.volume >= 0.999 * piece.convex_hull.volume
        assert piece.bounding_box_oriented.extents.min() >= 1.5e-3
    solid = union_of(part)
    assert 0.9 <= solid.volume / part.mesh.volume <= 1.7
    # Nothing seen sticks out of what is felt; what is felt may close narrow bores and the gaps of teeth.
    assert _outside(part, surface_points(part.mesh, 150)).max() < 1.8e-3
    gaps = SurfaceDistance(part.mesh)(surface_points(solid, 400))
    assert np.percentile(gaps, 90) < 2.6e-3 and gaps.max() < 7.1e-3


def _outside(part, points: np.ndarray) -> np.ndarray:
    """Return how far points lie outside all of the convex pieces, in metres; negative inside of one."""
    depths = [
        ((points[:, None] - piece.triangles[:, 0]) * piece.face_normals).sum(-1).max(axis=1) for piece in part.collision
    ]
    return np.min(depths, axis=0)


@pytest.mark.parametrize("name", NAMES)
def test_mujoco_body_has_the_parts_mass_and_inertia(name):
    part = get_part(name)
    spec = mujoco.MjSpec()
    add_part(spec, part, "p")
    model = spec.compile()
    body = model.body("p").id
    assert model.body_mass[body] == pytest.approx(part.mass_kg, rel=1e-6)
    expected = np.linalg.eigvalsh(part.density_kg_m3 * np.asarray(part.mesh.moment_inertia))
    assert np.sort(model.body_inertia[body]) == pytest.approx(np.sort(expected), rel=1e-5)
    assert model.body_ipos[body] == pytest.approx(np.asarray(part.mesh.center_mass), abs=1e-9)


def test_holes_stay_holes_in_contact():
    for name in ("hex_nut", "bushing", "eye_bolt", "tri_flange", "pillow_block", "cable_clip", "connecting_rod"):
        assert _outside(get_part(name), _bore_centre(name)[None])[0] > 5e-3, name


def _bore_centre(name: str) -> np.ndarray:
    """Return a point on the axis of the part's large bore, in the part frame."""
    drawn_mm = {"eye_bolt": (0, 0, 20), "pillow_block": (0, 0, 24), "tri_flange": (0, 0, 6)}.get(name, (0, 0, 0))
    return 1e-3 * np.array(drawn_mm) - get_part(name).T_cad_part[:3, 3]


def test_the_same_name_gives_the_same_object():
    assert get_part("hex_bolt") is get_part("hex_bolt")


def test_parts_are_the_same_in_another_process():
    code = (
        "from simpick.assets import get_part, library_part_names, random_part\n"
        "parts = [*map(get_part, library_part_names()), *map(random_part, (0, 5))]\n"
        "print(*[part.content_hash for part in parts])"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert other == [get_part(n).content_hash for n in NAMES] + [random_part(k).content_hash for k in (0, 5)]
    assert len(set(other)) == len(other)


@pytest.mark.parametrize("seed", range(30))
def test_random_part_is_a_valid_solid(seed):
    part = random_part(seed)
    assert part.mesh.is_watertight and part.mesh.body_count == 1
    assert 0.025 <= part.extents_m.max() <= 0.0901
    assert 0 < part.mass_kg <= 0.2501
    assert 1 <= len(part.collision) <= 12
    assert all(piece.volume >= 0.999 * piece.convex_hull.volume for piece in part.collision)
    assert 0.85 < union_of(part).volume / part.mesh.volume < 1.4


def test_random_parts_are_reached_by_name_and_not_listed():
    assert get_part("random_3") is random_part(3)
    assert not any(name.startswith("random_") for name in part_names())


def test_negative_seed_is_an_error():
    with pytest.raises(ConfigError, match="seed must not be negative, got -1"):
        random_part(-1)
