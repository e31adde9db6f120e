"""Actions and TCP poses are two forms of the same thing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.envs.actions import ABSTAIN, decode_action, encode_action, finite_values
from simpick.envs.spaces import action_space
from simpick.errors import ConfigError
from simpick.geometry import random_rotation, rotation_angle, transform
from simpick.scene.config import BinConfig
from simpick.scene.workspace import tcp_workspace

WORKSPACE = tcp_workspace(BinConfig())


@pytest.mark.parametrize("action", [np.zeros(3), np.zeros((1, 10)), np.full(10, np.nan)])
def test_other_than_ten_finite_numbers_are_refused(action: np.ndarray) -> None:
    with pytest.raises(ConfigError, match=r"an action must be 10 finite numbers in \[-1, 1\], got \["):
        decode_action(action, WORKSPACE)


@given(st.integers(0, 2**32 - 1))
def test_poses_survive_the_round_trip(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = transform(random_rotation(rng), rng.uniform(WORKSPACE.lower_m, WORKSPACE.upper_m))
    opening = rng.uniform(0.0, 0.085)
    action = encode_action(T, opening, WORKSPACE)
    assert action in action_space()
    decoded = decode_action(action, WORKSPACE)
    assert decoded is not None
    # Actions are float32, so poses come back to well under a micrometre and a hundredth of a degree.
    np.testing.assert_allclose(decoded[0][:3, 3], T[:3, 3], atol=1e-6)
    assert rotation_angle(T[:3, :3].T @ decoded[0][:3, :3]) < 1e-5
    assert decoded[1] == pytest.approx(opening, abs=1e-7)


@pytest.mark.parametrize(("opening_m", "max_opening_m"), [(0.12, 0.14), (0.0, 0.0)])
def test_openings_are_those_of_the_gripper(opening_m: float, max_opening_m: float) -> None:
    T = transform(translation=WORKSPACE.centre_m)
    action = encode_action(T, opening_m, WORKSPACE, max_opening_m)
    assert action in action_space()
    decoded = decode_action(action, WORKSPACE, max_opening_m)
    assert decoded is not None and decoded[1] == pytest.approx(opening_m, abs=1e-7)


@given(st.lists(st.floats(-1, 1, width=32), min_size=10, max_size=10))
def test_every_action_is_a_pose_or_abstains(values: list[float]) -> None:
    decoded = decode_action(np.array(values, np.float32), WORKSPACE)
    if decoded is None:
        assert not np.any(values[3:9])
    else:
        R = decoded[0][:3, :3]
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-6)
        assert np.linalg.det(R) > 0


def test_zeros_abstain() -> None:
    assert decode_action(ABSTAIN, WORKSPACE) is None


def test_poses_outside_the_workspace_are_refused() -> None:
    T = transform(translation=np.array([0.5, 0.0, 1.000042]))
    with pytest.raises(ConfigError, match=r"must lie in the workspace \(0.35, .*got \[0.5, 0.0, 1.0\] m"):
        encode_action(T, 0.05, WORKSPACE)


@pytest.mark.parametrize("action", [None, "close", [0.0] * 9, [[0.0] * 10], [0.0] * 9 + [None], [[0.0], 1.0], {}, 1j])
def test_what_is_not_ten_numbers_is_refused(action: object) -> None:
    with pytest.raises(ConfigError, match=r"an action must be 10 finite numbers in \[-1, 1\], got "):
        finite_values(action, 10)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(value: float) -> None:
    with pytest.raises(ConfigError, match=r"10 finite numbers in \[-1, 1\], got \[.*(nan|inf)\]"):
        decode_action(np.append(np.zeros(9), value), WORKSPACE)


def test_numbers_beyond_one_are_cut_off() -> None:
    np.testing.assert_array_equal(finite_values([7, -7.0, 0.5], 3), [1.0, -1.0, 0.5])


@pytest.mark.parametrize("corner", [WORKSPACE.lower_m, WORKSPACE.upper_m])
def test_the_workspace_ends_at_its_corners(corner: np.ndarray) -> None:
    action = encode_action(transform(translation=np.array(corner)), 0.05, WORKSPACE)
    np.testing.assert_allclose(np.abs(action[:3]), 1.0)
    outside = np.array(corner) + 1e-3 * np.sign(np.array(corner) - WORKSPACE.centre_m)
    with pytest.raises(ConfigError, match="must lie in the workspace"):
        encode_action(transform(translation=outside), 0.05, WORKSPACE)


def test_openings_beyond_the_grippers_are_cut_off() -> None:
    T = transform(translation=WORKSPACE.centre_m)
    assert encode_action(T, 0.2, WORKSPACE, 0.085)[9] == 1.0
    assert encode_action(T, -0.01, WORKSPACE, 0.085)[9] == -1.0
    assert encode_action(T, 0.0, WORKSPACE, 0.0)[9] == -1.0, "a gripper without an opening"


@pytest.mark.parametrize(
    ("x", "y"), [([0.0, 0.6, 0.8], [1, 0, 0]), ([0.6, 0.0, 0.8], [0, 1, 0]), ([0.8, 0.6, 0.0], [0, 0, 1])]
)
def test_parallel_columns_keep_the_first_axis(x: list[float], y: list[float]) -> None:
    for columns in ([*x, *(-0.5 * np.array(x))], [*x, 0, 0, 0], [0, 0, 0, *x]):
        decoded = decode_action(np.array([0, 0, 0, *columns, 0.0]), WORKSPACE)
        assert decoded is not None
        np.testing.assert_allclose(decoded[0][:3, 0], x, atol=1e-6)
        np.testing.assert_allclose(decoded[0][:3, 1], y, atol=1e-6)
