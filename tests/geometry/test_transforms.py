"""Rigid transforms by axiom: group laws, round trips, and the places where formulas lose their digits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from simpick.geometry import (
    invert,
    look_at,
    matrix_from_quaternion,
    quaternion_from_matrix,
    random_rotation,
    rotation_angle,
    rotation_from_6d,
    rotation_to_6d,
    so3_exp,
    so3_log,
    transform,
    transform_points,
)

ANGLES = [0.0, 1e-12, 1e-8, 1e-4, 0.019, 0.021, 1.0, 3.0, np.pi - 1e-4, np.pi - 1e-8, np.pi]
AXES = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, -0.8, 0.0), (1 / 3, 2 / 3, -2 / 3)]
seeds = st.integers(0, 2**32 - 1)


def random_transforms(seed: int, shape: tuple[int, ...] = (4,)) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transform(random_rotation(rng, shape), rng.normal(size=(*shape, 3)))


@given(seeds)
def test_transforms_are_a_group(seed: int) -> None:
    A, B, C = random_transforms(seed, (3, 4))
    np.testing.assert_allclose((A @ B) @ C, A @ (B @ C), atol=1e-12)
    np.testing.assert_allclose(A @ invert(A), np.broadcast_to(np.eye(4), A.shape), atol=1e-12)
    np.testing.assert_allclose(invert(A @ B), invert(B) @ invert(A), atol=1e-12)


@given(seeds)
def test_inner_names_cancel_on_points(seed: int) -> None:
    T_a_b, T_b_c = random_transforms(seed, (2,))
    points_c = np.random.default_rng(seed).normal(size=(7, 3))
    np.testing.assert_allclose(
        transform_points(T_a_b, transform_points(T_b_c, points_c)),
        transform_points(T_a_b @ T_b_c, points_c),
        atol=1e-12,
    )


def test_one_cloud_meets_many_transforms() -> None:
    Ts = random_transforms(0, (5,))
    points = np.random.default_rng(1).normal(size=(7, 3))
    assert transform_points(Ts, points).shape == (5, 7, 3)
    assert transform_points(Ts[:, None], points[None]).shape == (5, 1, 7, 3)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("angle", ANGLES)
def test_so3_log_inverts_exp_from_identity_to_half_turn(axis: tuple[float, ...], angle: float) -> None:
    w = angle * np.array(axis)
    R = so3_exp(w)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1)
    back = so3_log(R)
    # At a half turn, both signs of the axis are the same rotation.
    assert min(np.abs(back - w).max(), np.abs(back + w).max() + (angle < np.pi - 1e-9)) < 1e-12
    assert rotation_angle(R) == pytest.approx(angle, abs=1e-12)


@pytest.mark.parametrize("shape", [(), (1,), (50,), (4, 5)])
def test_conversions_agree_with_scipy(shape: tuple[int, ...]) -> None:
    R = random_rotation(np.random.default_rng(0), shape)
    expected = Rotation.from_matrix(R)
    np.testing.assert_allclose(so3_log(R), expected.as_rotvec(), atol=1e-14)
    np.testing.assert_allclose(so3_exp(so3_log(R)), R, atol=1e-14)
    q = quaternion_from_matrix(R)
    np.testing.assert_allclose(q, expected.as_quat(canonical=True, scalar_first=True), atol=1e-14)
    np.testing.assert_allclose(matrix_from_quaternion(q), R, atol=1e-14)
    assert rotation_angle(R).shape == shape


@given(seeds)
def test_quaternions_round_trip_and_multiply_like_matrices(seed: int) -> None:
    R = random_rotation(np.random.default_rng(seed), (3,))
    q = quaternion_from_matrix(R)
    assert (q[:, 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1)
    np.testing.assert_allclose(matrix_from_quaternion(q), R, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quaternion(-3 * q), R, atol=1e-12)


def test_quaternion_order_is_wxyz() -> None:
    np.testing.assert_allclose(quaternion_from_matrix(so3_exp(np.array([0, 0, np.pi / 2]))), np.sqrt([0.5, 0, 0, 0.5]))


@given(seeds)
def test_6d_round_trips_and_ignores_scale_and_shear(seed: int) -> None:
    R = random_rotation(np.random.default_rng(seed), (3,))
    columns = rotation_to_6d(R)
    np.testing.assert_allclose(rotation_from_6d(columns), R, atol=1e-12)
    np.testing.assert_array_equal(columns[:, :3], R[:, :, 0])
    sheared = np.concatenate([2 * columns[:, :3], 0.5 * columns[:, 3:] - 3 * columns[:, :3]], -1)
    np.testing.assert_allclose(rotation_from_6d(sheared), R, atol=1e-12)


@given(arrays(float, 6, elements=st.one_of(st.just(0.0), st.just(1e-12), st.floats(-1, 1))))
def test_6d_makes_a_rotation_of_any_action(action: np.ndarray) -> None:
    R = rotation_from_6d(action)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1)


def test_random_rotations_are_uniform() -> None:
    R = random_rotation(np.random.default_rng(0), (20000,))
    # The mean of a uniform rotation is zero; its angle has the density (1 - cos a) / pi, whose mean is pi/2 + 2/pi.
    assert np.abs(R.mean(0)).max() < 0.02
    assert rotation_angle(R).mean() == pytest.approx(np.pi / 2 + 2 / np.pi, abs=0.02)


@pytest.mark.parametrize("eye", [(1.0, 0.0, 0.0), (0.3, -0.4, 0.9), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)])
def test_look_at_puts_the_target_on_the_axis(eye: tuple[float, ...]) -> None:
    T_world_camera = look_at(np.array(eye), np.zeros(3))
    target = transform_points(invert(T_world_camera), np.zeros((1, 3)))[0]
    np.testing.assert_allclose(target, np.array([0, 0, np.linalg.norm(eye)]), atol=1e-12)
    assert np.linalg.det(T_world_camera[:3, :3]) == pytest.approx(1)


def test_look_at_keeps_up_upwards_in_the_image() -> None:
    T_world_camera = look_at(np.array([1.0, 0.5, 0.3]), np.zeros(3))
    above = transform_points(invert(T_world_camera), np.array([[0.0, 0.0, 0.1]]))[0]
    assert above[1] < 0


def test_rotations_from_columns_of_a_batch_are_those_of_each() -> None:
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(3, 4, 6))
    columns[0, 0, :3] = 0.0
    columns[1, 1, 3:] = 2.5 * columns[1, 1, :3]
    columns[2, 2] = 0.0
    batch = rotation_from_6d(columns)
    for k in np.ndindex(3, 4):
        np.testing.assert_allclose(batch[k], rotation_from_6d(columns[k]), atol=1e-12)
        np.testing.assert_allclose(batch[k] @ batch[k].T, np.eye(3), atol=1e-12)


def test_columns_without_direction_are_replaced() -> None:
    np.testing.assert_allclose(rotation_from_6d(np.zeros(6)), np.eye(3), atol=1e-12)
    # y lies along the axis that is least aligned with x, of equal ones the first.
    x = np.array([0.0, 0.6, 0.8])
    np.testing.assert_allclose(rotation_from_6d(np.array([*x, *x]))[:, 1], [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize("up", [None, (0.0, 1.0, 0.0), (1.0, 0.0, 1.0)])
def test_up_is_up_in_the_image(up: tuple[float, float, float] | None) -> None:
    eye, target = np.array([0.3, -0.2, 0.9]), np.array([0.1, 0.4, 0.2])
    R = look_at(eye, target, None if up is None else np.array(up))[:3, :3]
    expected = np.array((0.0, 0.0, 1.0) if up is None else up)
    assert R[:, 0] @ expected == pytest.approx(0.0, abs=1e-12) and R[:, 1] @ expected < 0
    np.testing.assert_allclose(R[:, 2], (target - eye) / np.linalg.norm(target - eye), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_view_along_up_has_x_up_and_a_view_along_x_then_y() -> None:
    down = look_at(np.array([0.0, 0.0, 1.0]), np.zeros(3))[:3, :3]
    np.testing.assert_allclose(down[:, 1], [-1, 0, 0], atol=1e-12)
    along = look_at(np.zeros(3), np.array([2.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))[:3, :3]
    np.testing.assert_allclose(along[:, 1], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(along[:, 2], [1, 0, 0], atol=1e-12)
