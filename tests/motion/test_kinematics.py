import mink
import numpy as np
import pytest

from simpick.assets.robots.registry import get_robot
from simpick.assets.robots.ur5e_inverse import forward, inverse
from simpick.geometry.transforms import rotation_angle, so3_exp, transform
from simpick.motion.kinematics import Kinematics, line

HOME = get_robot("ur5e").home_qpos
DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.fixture(scope="module")
def kinematics() -> Kinematics:
    return Kinematics(get_robot("ur5e"), transform(translation=np.array([0.0, 0.0, 0.19])))


def _pose(x, y, z, tilt=0.0, azimuth=0.0, yaw=0.0) -> np.ndarray:
    R = so3_exp(tilt * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])) @ DOWN @ so3_exp(np.array([0.0, 0.0, yaw]))
    return transform(R, np.array([x, y, z]))


def _poses_over_the_bin(n: int) -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    return [
        _pose(
            rng.uniform(0.37, 0.63),
            rng.uniform(-0.18, 0.18),
            rng.uniform(0.01, 0.15),
            tilt=rng.uniform(0, np.deg2rad(35)),
            azimuth=rng.uniform(0, 2 * np.pi),
            yaw=rng.uniform(0, 2 * np.pi),
        )
        for _ in range(n)
    ]


def test_closed_form_recovers_the_joints_it_came_from():
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3, 3, (50, 6)):
        solutions = inverse(forward(q), q)
        assert np.abs(solutions - q).max(axis=1).min() < 1e-6


def test_closed_form_solutions_all_reach_the_pose():
    rng = np.random.default_rng(2)
    for q in rng.uniform(-3, 3, (50, 6)):
        for solution in inverse(forward(q), HOME):
            assert np.allclose(forward(solution), forward(q), atol=1e-7)


def test_ik_reaches_every_pose_over_the_bin(kinematics):
    for T_world_tcp in _poses_over_the_bin(60):
        q = kinematics.solve_ik(T_world_tcp, HOME)
        assert q is not None
        reached = kinematics.forward(q)
        assert np.linalg.norm(reached[:3, 3] - T_world_tcp[:3, 3]) < 5e-4
        assert rotation_angle(reached[:3, :3].T @ T_world_tcp[:3, :3]) < np.deg2rad(0.2)
        assert (q >= kinematics.q_lower).all()
        assert (q <= kinematics.q_upper).all()


def test_ik_takes_the_solution_nearest_to_the_seed(kinematics):
    for T_world_tcp in _poses_over_the_bin(20):
        solutions = kinematics.solve_all(T_world_tcp, HOME)
        distances = [np.abs(q - HOME).max() for q in solutions]
        assert distances == sorted(distances)
        # A joint never goes the long way round.
        assert distances[0] <= np.pi + 1e-6


def test_ik_says_none_beyond_the_arms_reach(kinematics):
    assert kinematics.solve_ik(_pose(1.2, 0.0, 0.1), HOME) is None
    assert kinematics.solve_ik(_pose(0.02, 0.0, 0.1), HOME) is None


def test_mink_converges_from_a_start_nearby(kinematics):
    T_world_tcp = _pose(0.5, 0.1, 0.1, tilt=0.2)
    q = kinematics.solve_ik(T_world_tcp, HOME)
    assert q is not None
    again = kinematics.converge(T_world_tcp, q + 0.05)
    assert again is not None
    assert np.linalg.norm(kinematics.forward(again)[:3, 3] - T_world_tcp[:3, 3]) < 1e-4


def test_following_a_line_stays_on_it_without_jumps(kinematics):
    T_world_low = _pose(0.5, -0.1, 0.02, tilt=0.3, azimuth=1.0, yaw=0.7)
    T_world_high = T_world_low.copy()
    T_world_high[2, 3] = 0.3
    q = kinematics.solve_ik(T_world_low, HOME)
    assert q is not None
    qs = kinematics.follow(line(T_world_low, T_world_high), q)
    assert qs is not None
    assert np.abs(np.diff(qs, axis=0)).max() < 0.15
    for mid in (qs[:-1] + qs[1:]) / 2:
        off = kinematics.forward(mid)[:2, 3] - T_world_low[:2, 3]
        assert np.linalg.norm(off) < 5e-4


def test_a_line_that_turns_the_tool_is_refused():
    with pytest.raises(ValueError, match="must keep its orientation"):
        line(_pose(0.5, 0, 0.1), _pose(0.5, 0, 0.2, yaw=0.1))


def test_every_step_is_the_one_that_mink_would_make(kinematics):
    configuration = mink.Configuration(kinematics.model)
    task = mink.FrameTask(kinematics.tcp_site, "site", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-4)
    limits = [mink.ConfigurationLimit(kinematics.model)]
    rng = np.random.default_rng(3)
    steps = 0
    for T_world_tcp in _poses_over_the_bin(20):
        start = HOME + rng.normal(size=6) * 0.4
        found = kinematics.converge(T_world_tcp, start)
        configuration.update(np.clip(start, kinematics.q_lower, kinematics.q_upper))
        task.set_target(mink.SE3.from_matrix(T_world_tcp))
        for _ in range(20):
            error = task.compute_error(configuration)
            if np.linalg.norm(error[:3]) < 1e-4 and np.linalg.norm(error[3:]) < np.deg2rad(0.05):
                assert found is not None
                assert np.array_equal(found, configuration.q)
                break
            speed = mink.solve_ik(configuration, [task], 1.0, "daqp", damping=1e-6, limits=limits)
            configuration.integrate_inplace(speed, 1.0)
            steps += 1
        else:
            assert found is None
    assert steps > 60
