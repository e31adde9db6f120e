import numpy as np
import pytest
import trimesh

from simpick.assets.grippers import JAW_STROKE_M, JawGripper, SuctionGripper
from simpick.assets.grippers.sampling.boxes import points_in_boxes
from simpick.assets.grippers.sampling.part_surface import PartSurface
from simpick.assets.grippers.sampling.resting import resting_directions, resting_floors
from simpick.assets.grippers.sampling.selection import diverse, expanded, pose_distance
from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.geometry.symmetry import SymmetryGroup
from simpick.geometry.transforms import invert, transform, transform_points
from simpick.grasping import candidate_grasps
from simpick.records import Grasp

PARTS = ("z_bracket", "hex_nut")


@pytest.fixture(scope="module")
def jaw_candidates() -> dict[str, list[Grasp]]:
    return {name: candidate_grasps(get_part(name), "jaw") for name in PARTS}


@pytest.fixture(scope="module")
def suction_candidates() -> dict[str, list[Grasp]]:
    return {name: candidate_grasps(get_part(name), "suction") for name in PARTS}


def seen_from(grasp: Grasp, part_name: str) -> np.ndarray:
    return transform_points(invert(grasp.T_part_tcp), PartSurface(get_part(part_name), seed=7).points)


@pytest.mark.parametrize("name", PARTS)
def test_open_fingers_miss_the_part(name: str, jaw_candidates: dict[str, list[Grasp]]) -> None:
    for grasp in jaw_candidates[name]:
        boxes = JawGripper().boxes(grasp.width_m + 0.006)
        assert not points_in_boxes(seen_from(grasp, name), boxes, margin_m=-0.0005).any()


@pytest.mark.parametrize("name", PARTS)
def test_the_closing_pads_meet_the_part_in_their_middle(name: str, jaw_candidates: dict[str, list[Grasp]]) -> None:
    for grasp in jaw_candidates[name]:
        points = seen_from(grasp, name)
        between = (np.abs(points[:, 1]) < 0.010) & (points[:, 2] < 0.010) & (points[:, 2] > -0.040)
        assert -points[between, 0].min() == pytest.approx(grasp.width_m / 2, abs=0.0015)
        assert points[between, 0].max() == pytest.approx(grasp.width_m / 2, abs=0.0015)
        assert 0 < grasp.width_m < JAW_STROKE_M


@pytest.mark.parametrize("name", PARTS)
def test_every_resting_pose_has_grasps_from_above_that_stay_off_the_floor(
    name: str, jaw_candidates: dict[str, list[Grasp]]
) -> None:
    part = get_part(name)
    for floor in resting_floors(part):
        usable = 0
        for grasp in expanded(jaw_candidates[name], part.symmetries):
            fingertips = JawGripper().boxes(grasp.width_m + 0.006)[:2].reshape(-1, 3)
            heights = transform_points(grasp.T_part_tcp, fingertips) @ floor[:3] - floor[3]
            usable += bool(-grasp.T_part_tcp[:3, 2] @ floor[:3] > 0.7 and heights.min() > 0)
        assert usable >= 2


@pytest.mark.parametrize("name", PARTS)
def test_the_suction_face_lies_on_the_part_and_its_head_misses_it(
    name: str, suction_candidates: dict[str, list[Grasp]]
) -> None:
    assert suction_candidates[name]
    for grasp in suction_candidates[name]:
        points = seen_from(grasp, name)
        under = np.linalg.norm(points[:, :2], axis=1) < 0.010
        assert np.abs(points[under, 2]).min() < 0.002
        lance = SuctionGripper().boxes(0.0)[1:]
        assert not points_in_boxes(points[points[:, 2] < -0.003], lance).any()


def test_candidates_are_the_same_every_time(suction_candidates: dict[str, list[Grasp]]) -> None:
    again = candidate_grasps(get_part("hex_nut"), "suction")
    for first, second in zip(suction_candidates["hex_nut"], again, strict=True):
        np.testing.assert_array_equal(first.T_part_tcp, second.T_part_tcp)


def test_rays_count_every_wall_of_a_tube() -> None:
    surface = PartSurface(get_part("bushing"))
    crossings = surface.crossings(np.array([-0.05, 0.001, 0.002]), np.array([1.0, 0.0, 0.0]))
    assert len(crossings) == 4
    assert [np.sign(normal[0]) for _, normal in crossings] == [-1, 1, -1, 1]
    assert crossings[1][0] - crossings[0][0] == pytest.approx(0.005, abs=1e-4)


def test_a_part_on_two_symmetric_sides_rests_in_one_way() -> None:
    ups = resting_floors(get_part("hex_nut"))[:, :3]
    assert (np.abs(ups[:, 2]) > 0.99).sum() == 1


def test_a_plate_comes_to_rest_on_its_faces_first_and_on_its_edges_hardly() -> None:
    plate = trimesh.creation.box((0.05, 0.04, 0.0005))
    ups = resting_directions(Part("plate", plate, (plate,)))
    assert np.abs(ups[:2, 2]) == pytest.approx([1.0, 1.0]) and ups[0, 2] * ups[1, 2] < 0
    # Hardly ever does it stay on a narrow side.
    assert len(ups) == 2
    cube = trimesh.creation.box((0.03, 0.03, 0.03))
    assert len(resting_directions(Part("cube", cube, (cube,)))) == 6


def test_a_round_part_comes_to_rest_on_any_side_although_each_facet_is_unlikely() -> None:
    shaft = trimesh.creation.cylinder(0.005, 0.08, sections=128)
    ups = resting_directions(Part("shaft", shaft, (shaft,)))
    assert len(ups) >= 120 and np.abs(ups[:, 2]).max() < 1e-6


def test_diverse_keeps_the_best_of_what_symmetry_makes_equal() -> None:
    flip = transform(np.diag([-1.0, -1.0, 1.0]))
    T = transform(translation=np.array([0.03, 0.0, 0.0]))
    other = transform(translation=np.array([0.0, 0.0, 0.03]))
    grasps = [Grasp(T, 0.02, 0.5), Grasp(flip @ T, 0.02, 0.9), Grasp(other, 0.02, 0.1)]
    kept = diverse(grasps, SymmetryGroup(flip[None]), 2, count=5, spacing_m=0.005)
    assert [grasp.quality for grasp in kept] == [0.9, 0.1]
    assert len(diverse(grasps, SymmetryGroup(), 2, count=5, spacing_m=0.005)) == 3


def test_expansion_repeats_each_grasp_over_the_group() -> None:
    part = get_part("hex_nut")
    grasp = Grasp(transform(translation=np.array([0.03, 0.0, 0.0])), 0.02, 0.5)
    group = part.symmetries.transforms()
    found = np.stack([g.T_part_tcp for g in expanded([grasp], part.symmetries)])
    assert len(found) == len(group)
    assert all(pose_distance(T @ grasp.T_part_tcp, found, 0.02).min() < 1e-6 for T in group)
