"""Estimated poses are moved along their lines of sight until the parts rest in the bin."""

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import so3_exp, transform, transform_points
from simpick.grasping.resting import raised_onto_floor, resting_poses

NUT = get_part("hex_nut")
EYE_M = np.array([0.5, 0.0, 0.9])


def flat(x_m: float = 0.6, y_m: float = 0.1, bottom_m: float = 0.0) -> np.ndarray:
    """Return a hex nut (16 mm high) lying flat at this height."""
    return transform(so3_exp(np.array([0.0, 0.0, 0.3])), np.array([x_m, y_m, 0.008 + bottom_m]))


def bottom_m(T_world_part: np.ndarray) -> float:
    return float(transform_points(T_world_part, np.asarray(NUT.mesh.vertices))[:, 2].min())


def moved_along_sight(T_world_part: np.ndarray, distance_m: float) -> np.ndarray:
    """Return the pose further away from the camera, as an error of depth puts it."""
    sight = T_world_part[:3, 3] - EYE_M
    moved = T_world_part.copy()
    moved[:3, 3] += distance_m * sight / np.linalg.norm(sight)
    return moved


@pytest.mark.parametrize("error_m", [-0.05, -0.01, 0.01, 0.03])
def test_an_error_of_depth_of_a_part_on_the_floor_vanishes(error_m: float) -> None:
    (T,) = resting_poses([NUT], [moved_along_sight(flat(), error_m)], EYE_M)
    np.testing.assert_allclose(T, flat(), atol=2e-4)


def test_a_part_on_another_stays_there() -> None:
    poses = [flat(), flat(x_m=0.61, bottom_m=0.016)]
    for T, expected in zip(resting_poses([NUT, NUT], poses, EYE_M), poses, strict=True):
        np.testing.assert_allclose(T, expected, atol=2e-4)


def test_a_part_over_another_is_lowered_onto_it() -> None:
    lower, upper = resting_poses([NUT, NUT], [flat(), moved_along_sight(flat(bottom_m=0.016), -0.02)], EYE_M)
    np.testing.assert_allclose(lower, flat(), atol=2e-4)
    assert bottom_m(upper) == pytest.approx(0.016, abs=5e-4)


def test_parts_are_lowered_after_what_carries_them() -> None:
    poses = [moved_along_sight(flat(bottom_m=0.016), -0.02), moved_along_sight(flat(), -0.01)]
    upper, lower = resting_poses([NUT, NUT], poses, EYE_M)
    assert bottom_m(lower) == pytest.approx(0.0, abs=5e-4)
    assert bottom_m(upper) == pytest.approx(0.016, abs=5e-4)


def test_a_part_beside_another_is_lowered_past_it() -> None:
    poses = [flat(y_m=-0.1), moved_along_sight(flat(y_m=0.1), -0.03)]
    beside, lowered = resting_poses([NUT, NUT], poses, EYE_M)
    np.testing.assert_allclose(beside, poses[0], atol=2e-4)
    assert bottom_m(lowered) == pytest.approx(0.0, abs=5e-4)


def test_only_the_distance_changes() -> None:
    before = moved_along_sight(flat(), 0.02)
    after = raised_onto_floor(NUT, before, EYE_M)
    np.testing.assert_array_equal(after[:3, :3], before[:3, :3])
    sights = [(T[:3, 3] - EYE_M) / np.linalg.norm(T[:3, 3] - EYE_M) for T in (before, after)]
    np.testing.assert_allclose(sights[1], sights[0], atol=1e-9)


def test_a_part_above_the_floor_is_not_raised() -> None:
    np.testing.assert_array_equal(raised_onto_floor(NUT, flat(bottom_m=0.02), EYE_M), flat(bottom_m=0.02))


def test_a_level_line_of_sight_moves_nothing() -> None:
    sunk = flat(bottom_m=-0.005)
    np.testing.assert_array_equal(raised_onto_floor(NUT, sunk, np.array([2.0, 0.1, 0.05])), sunk)


def test_a_pose_far_outside_and_one_in_the_camera_are_left() -> None:
    far, inside = transform(translation=np.array([90.0, -90.0, 0.5])), transform(translation=EYE_M)
    near, *others = resting_poses([NUT, NUT, NUT], [moved_along_sight(flat(), 0.02), far, inside], EYE_M)
    np.testing.assert_allclose(near, flat(), atol=2e-4)
    np.testing.assert_array_equal(others[0], far)


def test_an_empty_bin_is_answered() -> None:
    assert resting_poses([], [], EYE_M) == []
