import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simpick.motion.trajectory import JointSegment, PathTrajectory, period_ends, quintic

angles = st.lists(st.floats(-6.0, 6.0), min_size=6, max_size=6).map(np.array)
SPEED, ACCELERATION, TCP_SPEED = 2.5, 9.0, 0.5


def _sampled(trajectory, n=801):
    t = np.linspace(0, trajectory.duration_s, n)
    return t, *trajectory.states(t.tolist())


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
        (q,), (qd,) = segment.states([t])
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
    (q_start, q_end), (qd_start, qd_end) = path.states([0.0, path.duration_s])
    assert np.array_equal(q_end, qs[-1])
    assert not qd_end.any()
    assert np.allclose(q_start, qs[0], atol=1e-12)
    assert not qd_start.any()


def test_speed_is_the_derivative_of_position():
    qs, arc = _path(0)
    for trajectory in (
        PathTrajectory.within(qs, arc, SPEED, ACCELERATION, TCP_SPEED),
        JointSegment.within(qs[0], qs[7], SPEED, ACCELERATION),
    ):
        t = 0.37 * trajectory.duration_s
        (before, _, after), (_, speed, _) = trajectory.states([t - 1e-5, t, t + 1e-5])
        assert np.allclose(speed, (after - before) / 2e-5, atol=1e-5)


def test_quintic_starts_and_ends_at_rest_without_acceleration():
    assert quintic(0.0) == (0.0, 0.0, 0.0)
    assert quintic(1.0) == (1.0, 0.0, 0.0)


def test_control_periods_cover_the_motion_and_no_more():
    assert period_ends(0.0, 0.01) == []
    assert len(period_ends(0.035, 0.01)) == 4
    assert 0.03 < period_ends(0.03, 0.01)[-1] + 1e-9 < 0.03 + 1e-6


def test_a_motion_of_no_length_has_its_end_at_any_time():
    here = JointSegment.within(np.ones(6), np.ones(6), SPEED, ACCELERATION)
    q, qd = here.states([0.0, 1.0])
    assert np.array_equal(q, np.ones((2, 6)))
    assert not qd.any()
