"""`TwistServo` commands what joints can do, and gives up what they cannot."""

import mujoco
import numpy as np
import pytest

from simpick.assets.grippers import JawGripper
from simpick.assets.robots.registry import get_robot
from simpick.motion import Kinematics, TwistServo
from simpick.motion.twist_servo import MAX_ACCELERATION_RAD_S2, MAX_LEAD_RAD
from simpick.scene.workspace import Box

from .mink_servo import mink_commands

EVERYWHERE = Box((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0))
PERIODS_S = [0.01] * 5
SPEED_LIMIT = 2.5


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(get_robot("ur5e"), JawGripper().T_base_tcp)


def servo(kinematics: Kinematics, q_start=None, workspace: Box = EVERYWHERE) -> TwistServo:
    q_start = get_robot("ur5e").home_qpos if q_start is None else q_start
    return TwistServo(kinematics, q_start, SPEED_LIMIT, workspace, PERIODS_S)


def follow(arm: TwistServo, q: np.ndarray, twists: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return joint angles and speeds of an arm that obeys at once, one row a control period."""
    qs, qds = [], []
    for twist in twists:
        tick_qs, tick_qds = arm.commands(twist, q)
        q = tick_qs[-1]
        qs.append(tick_qs)
        qds.append(tick_qds)
    return np.concatenate(qs), np.concatenate(qds)


def test_a_straight_line_is_kept_to_a_tenth_of_a_millimetre(kinematics) -> None:
    home = get_robot("ur5e").home_qpos
    twist = np.array([0.15, 0.2, -0.05, 0, 0, 0])
    qs, _ = follow(servo(kinematics), home, np.concatenate([np.tile(twist, (30, 1)), np.zeros((1, 6))]))
    points = np.array([kinematics.forward(q)[:3, 3] for q in qs]) - kinematics.forward(home)[:3, 3]
    direction = twist[:3] / np.linalg.norm(twist[:3])
    along = points @ direction
    assert np.abs(points - along[:, None] * direction).max() < 1e-4
    assert along[-1] == pytest.approx(np.linalg.norm(twist[:3]) * 30 * 0.05, abs=1e-3)


@pytest.mark.parametrize("seed", [0, 1])
def test_wild_commands_keep_speed_and_acceleration_of_every_joint(kinematics, seed: int) -> None:
    rng = np.random.default_rng(seed)
    twists = rng.choice([-1.0, 1.0], (60, 6)) * np.repeat([0.5, 3.0], 3)
    qs, qds = follow(servo(kinematics), get_robot("ur5e").home_qpos, twists)
    assert 2.0 < np.abs(qds).max() < SPEED_LIMIT + 1e-6
    assert np.abs(np.diff(qds, axis=0)).max() < MAX_ACCELERATION_RAD_S2 * 0.01 + 1e-6
    np.testing.assert_allclose(np.diff(qs, axis=0), qds[1:] * 0.01, atol=1e-9)


def test_a_joint_stops_at_its_limit_while_the_others_go_on(kinematics) -> None:
    q_start = get_robot("ur5e").home_qpos + np.array([0, 0, 0, 0, 0, 2 * np.pi + 1.0])
    turn = np.tile([0, 0, 0, 0, 0, -1.5], (40, 1))
    qs, _ = follow(servo(kinematics, q_start), q_start, turn)
    assert qs[:, 5].max() == pytest.approx(kinematics.q_upper[5], abs=1e-3)
    assert qs[:, 5].max() <= kinematics.q_upper[5]


def test_out_of_reach_it_stops_and_comes_back_at_once(kinematics) -> None:
    arm, home = servo(kinematics), get_robot("ur5e").home_qpos
    qs, _ = follow(arm, home, np.tile([0, -0.5, 0, 0, 0, 0], (60, 1)))
    far = kinematics.forward(qs[-1])[1, 3]
    back, _ = follow(arm, qs[-1], np.tile([0, 0.5, 0, 0, 0, 0], (6, 1)))
    assert far < -0.9
    assert kinematics.forward(back[-1])[1, 3] > far + 0.02


def test_the_position_stays_in_the_workspace_and_slides_along_its_faces(kinematics) -> None:
    home = get_robot("ur5e").home_qpos
    start = kinematics.forward(home)[:3, 3]
    box = Box((-1.0, -1.0, float(start[2]) - 0.05), (1.0, 1.0, 1.0))
    qs, _ = follow(servo(kinematics, workspace=box), home, np.tile([0.2, 0, -0.2, 0, 0, 0], (20, 1)))
    end = kinematics.forward(qs[-1])[:3, 3]
    assert end[2] == pytest.approx(box.lower_m[2], abs=1e-3)
    assert end[0] - start[0] == pytest.approx(0.2 * 0.975, abs=2e-3)


def test_a_blocked_arm_is_led_by_a_bounded_angle(kinematics) -> None:
    arm, home = servo(kinematics), get_robot("ur5e").home_qpos
    qs = np.empty((0, 6))
    for _ in range(20):
        qs, _ = arm.commands(np.array([0.2, 0, 0, 0, 0, 0]), home)
    # The lead is cut back before each tick, in which the command moves by at most its speed.
    assert np.abs(qs[-1] - home).max() < MAX_LEAD_RAD + 0.05 * SPEED_LIMIT
    assert np.abs(qs[0] - home).max() < MAX_LEAD_RAD + 0.01 * SPEED_LIMIT


def _motions() -> dict[str, tuple[np.ndarray, float, float]]:
    """Return twists, one row a tick, and the tolerances in rad and m, which limits that bind make wider."""
    rng, time_s = np.random.default_rng(0), np.arange(40) / 20
    waves = np.sin(time_s[:, None] * (1 + 0.3 * np.arange(6)))
    return {
        "line": (np.tile([0.15, 0.2, -0.05, 0, 0, 0], (30, 1)), 1e-6, 1e-6),
        "turn and shift": (waves * np.repeat([0.08, 0.25], 3), 1e-5, 1e-5),
        "random": (rng.uniform(-0.3, 0.3, (40, 6)) * np.repeat([0.25, 1.57], 3), 1e-4, 5e-5),
        "out of reach": (np.tile([0, -0.5, 0, 0, 0, 0], (60, 1)), 1e-4, 5e-5),
    }


@pytest.mark.parametrize("name", list(_motions()))
def test_it_moves_as_minks_quadratic_program_does(kinematics, name: str) -> None:
    twists, tolerance_rad, tolerance_m = _motions()[name]
    home = get_robot("ur5e").home_qpos
    qs, qds = follow(servo(kinematics), home, twists)
    expected = mink_commands(kinematics, home, twists, PERIODS_S, SPEED_LIMIT)
    np.testing.assert_allclose(qs, expected, atol=tolerance_rad)
    points, expected_points = (np.array([kinematics.forward(q)[:3, 3] for q in each]) for each in (qs, expected))
    assert np.linalg.norm(points - expected_points, axis=1).max() < tolerance_m
    # Not by standing still.
    assert np.abs(qds).max() > 0.1


@pytest.mark.parametrize("scale", [0.5, 1.0])
def test_every_step_is_the_best_one_within_its_bounds(kinematics, monkeypatch, scale: float) -> None:
    solve, steepness, bound = mujoco.mju_boxQP, [], []

    def checked(step, factor, free, hessian, gradient, least, most):
        dimensions = solve(step, factor, free, hessian, gradient, least, most)
        slope = hessian @ step + gradient
        # At a bound the objective may only fall towards the outside.
        outwards = ((step <= least) & (slope > 0)) | ((step >= most) & (slope < 0))
        steepness.append(np.abs(np.where(outwards, 0.0, slope)).max())
        bound.append(outwards.any())
        return dimensions

    monkeypatch.setattr(mujoco, "mju_boxQP", checked)
    waves = np.sin(np.arange(200)[:, None] / 20 * (1 + 0.3 * np.arange(6)))
    follow(servo(kinematics), get_robot("ur5e").home_qpos, scale * waves * np.repeat([0.25, 1.57], 3))
    assert max(steepness) < 1e-7
    assert 0.1 < np.mean(bound) < 0.9
