"""The arm: kinematics against the published Denavit-Hartenberg table, servos, and the registry."""

import mujoco
import numpy as np
import pytest

from simpick.assets.robots import ur5e
from simpick.assets.robots.registry import get_robot
from simpick.errors import UnknownNameError


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    ur5e.add_ur5e(spec)
    return spec.compile()


def _published_forward(q: np.ndarray) -> np.ndarray:
    """Universal Robots' own table, multiplied out from the textbook matrix; the base is turned by 180 degrees."""
    table = [
        (0.1625, 0.0, np.pi / 2),
        (0.0, -0.425, 0.0),
        (0.0, -0.3922, 0.0),
        (0.1333, 0.0, np.pi / 2),
        (0.0997, 0.0, -np.pi / 2),
        (0.0996, 0.0, 0.0),
    ]
    T = np.diag([-1.0, -1.0, 1.0, 1.0])
    for angle, (d, a, alpha) in zip(q, table, strict=True):
        ct, st, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        )
    return T


def test_forward_kinematics_equal_the_published_table(model):
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for q in rng.uniform(-2 * np.pi, 2 * np.pi, (100, 6)):
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        flange = data.site("arm/flange")
        expected = _published_forward(q)
        assert np.abs(flange.xpos - expected[:3, 3]).max() < 1e-9
        assert np.abs(flange.xmat.reshape(3, 3) - expected[:3, :3]).max() < 1e-9


def test_link_masses_and_limits_are_those_of_the_real_arm(model):
    masses = [model.body(f"arm/{name}").mass[0] for name in ur5e.JOINT_NAMES]
    assert masses == pytest.approx([3.761, 8.058, 2.846, 1.37, 1.3, 0.365])
    assert np.allclose(model.jnt_range, [-2 * np.pi, 2 * np.pi])
    assert np.allclose(model.actuator_forcerange[:, 1], [150, 150, 150, 28, 28, 28])


def test_gravity_does_not_pull_the_arm_off_its_target(model):
    data = mujoco.MjData(model)
    data.qpos[:] = ur5e.HOME_QPOS
    data.ctrl[:] = ur5e.HOME_QPOS
    mujoco.mj_step(model, data, nstep=500)
    assert np.abs(data.qpos - ur5e.HOME_QPOS).max() < 1e-6


def test_servos_follow_a_moving_target_without_lag(model):
    data = mujoco.MjData(model)
    data.qpos[:] = ur5e.HOME_QPOS
    lag = 0.0
    # All joints move by 1 rad in 1 s along a minimum-jerk profile with a peak speed of 1.9 rad/s.
    for step in range(500):
        u = (step + 1) / 500
        wanted = ur5e.HOME_QPOS + u**3 * (10 - 15 * u + 6 * u**2)
        data.ctrl[:] = ur5e.servo_command(wanted, np.full(6, 30 * u**2 * (1 - u) ** 2))
        mujoco.mj_step(model, data)
        lag = max(lag, np.abs(data.qpos - wanted).max())
    # Without the speed term of `servo_command` the lag is kv/kp times 1.9 rad/s, about 0.09 rad.
    assert lag < 0.02
    mujoco.mj_step(model, data, nstep=50)
    assert np.abs(data.qpos - ur5e.HOME_QPOS - 1.0).max() < 1e-4


def test_home_points_the_tool_down_over_the_chute(model):
    data = mujoco.MjData(model)
    data.qpos[:] = ur5e.HOME_QPOS
    mujoco.mj_kinematics(model, data)
    flange = data.site("arm/flange")
    assert flange.xmat.reshape(3, 3)[:, 2] == pytest.approx([0, 0, -1], abs=1e-9)
    assert np.abs(flange.xpos[:2] - [0.25, -0.40]).max() < 0.01


def test_arm_meets_parts_but_not_itself(model):
    data = mujoco.MjData(model)
    data.qpos[:] = ur5e.HOME_QPOS
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    spec = mujoco.MjSpec()
    ur5e.add_ur5e(spec)
    ball = spec.worldbody.add_body(name="ball", pos=[0.0, 0.0, 0.25])
    ball.add_freejoint()
    ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.05, 0, 0])
    touching = spec.compile()
    data = mujoco.MjData(touching)
    mujoco.mj_forward(touching, data)
    assert data.ncon > 0


def test_unknown_robot_error_lists_the_known_ones():
    with pytest.raises(UnknownNameError, match=r"no robot named 'kuka'\. Valid: ur5e\."):
        get_robot("kuka")
