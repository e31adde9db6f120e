import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simpick.motion.trajectory import JointSegment, PathTrajectory, quintic

angles = st.lists(st.floats(-6.0, 6.0), min_size=6, max_size=6).map(np.array)
SPEED, ACCELERATION, TCP_SPEED = 2.5, 9.0, 0.5


def _sampled(trajectory, n=801):
    t = np.linspace(0, trajectory.duration_s, n)
    q, qd = (np.array(column) for column in zip(*map(trajectory.state, t), strict=True))
    return t, q, qd


@settings(max_examples=40, deadline=None)
@given(start=angles, end=angles)
def test_joint_segment_keeps_limits_and_meets_one_of_them(start, end):
    end = end if np.abs(end - start).max() > 1e-3 else start + 0.5
    segment = JointSegment.within(start, end, SPEED, ACCELERATION)
    t, _, qd = _sampled(segment)
    speed = np.abs(qd).max()
    acceleration = np.abs(np.diff(qd, axis=0) / np.diff(t)[:, None]).max()
    assert speed <= SPEED * (1 + 1e-9)
    assert acceleration <= ACCELERATION * (1 + 1e-6)
    assert speed > 0.99 * SPEED or acceleration > 0.97 * ACCELERATION


@settings(max_examples=40, deadline=None)
@given(start=angles, end=angles)
def test_joint_segment_starts_and_ends_exactly_and_at_rest(start, end):
    segment = JointSegment.within(start, end, SPEED, ACCELERATION)
    for t, wanted in ((0.0, start), (segment.duration_s, end), (segment.duration_s + 1.0, end)):
        q, qd = segment.state(t)
        if segment.duration_s > 0:
            assert np.array_equal(q, wanted)
        assert np.abs(qd).max() == 0


def _path(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    arc = np.concatenate([[0.0], np.cumsum(rng.uniform(0.005, 0.02, 15))])
    shape = rng.normal(size=(3, 6)) * np.array([[1.0], [0.3], [0.1]])
    phase = arc[:, None] / arc[-1] * np.pi * np.arange(1, 4)
    return np.sin(phase) @ shape, arc


@pytest.mark.parametrize("seed", range(5))
def test_path_keeps_joint_and_tcp_limits(seed):
    qs, arc = _path(seed)
    path = PathTrajectory.within(qs, arc, SPEED, ACCELERATION, TCP_SPEED)
    t, _, qd = _sampled(path)
    assert np.abs(qd).max() <= SPEED
    assert np.abs(np.diff(qd, axis=0) / np.diff(t)[:, None]).max() <= ACCELERATION
    assert 15 / 8 * arc[-1] / path.duration_s <= TCP_SPEED


@pytest.mark.parametrize("seed", range(3))
def test_path_runs_through_its_points_and_ends_at_rest(seed):
    qs, arc = _path(seed)
    path = PathTrajectory.within(qs, arc, SPEED, ACCELERATION, TCP_SPEED)
    _, q, _ = _sampled(path, 4001)
    for wanted in qs:
        assert np.abs(q - wanted).max(axis=1).min() < 5e-3
    q_end, qd_end = path.state(path.duration_s)
    assert np.array_equal(q_end, qs[-1])
    assert not qd_end.any()
    q_start, qd_start = path.state(0.0)
    assert np.allclose(q_start, qs[0], atol=1e-12)
    assert not qd_start.any()


def test_speed_is_the_derivative_of_position():
    qs, arc = _path(0)
    for trajectory in (
        PathTrajectory.within(qs, arc, SPEED, ACCELERATION, TCP_SPEED),
        JointSegment.within(qs[0], qs[7], SPEED, ACCELERATION),
    ):
        t = 0.37 * trajectory.duration_s
        numeric = (trajectory.state(t + 1e-5)[0] - trajectory.state(t - 1e-5)[0]) / 2e-5
        assert np.allclose(trajectory.state(t)[1], numeric, atol=1e-5)


def test_quintic_starts_and_ends_at_rest_without_acceleration():
    assert quintic(0.0) == (0.0, 0.0, 0.0)
    assert quintic(1.0) == (1.0, 0.0, 0.0)
