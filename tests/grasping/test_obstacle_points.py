"""`ObstaclePoints.around_box` leaves out no point of the box."""

import numpy as np
import pytest

from simpick.geometry import transform_points
from simpick.geometry.transforms import invert, so3_exp, transform
from simpick.grasping.obstacle_points import ObstaclePoints

LOWER_M, UPPER_M = np.array([-0.06, -0.02, -0.29]), np.array([0.05, 0.03, 0.01])


@pytest.mark.parametrize("turn_rad", [(np.pi, 0.0, 0.0), (2.6, 0.3, -0.4), (2.0, -1.0, 0.5), (0.4, 0.2, 0.0)])
def test_every_point_in_the_box_is_among_those_around_it(turn_rad: tuple[float, ...]) -> None:
    points = np.random.default_rng(0).uniform([-0.15, -0.2, 0.0], [0.15, 0.2, 0.08], (4000, 3))
    T_world_box = transform(so3_exp(np.array(turn_rad)), np.array([0.02, -0.03, 0.05]))
    local = transform_points(invert(T_world_box), points)
    inside = local[((local > LOWER_M) & (local < UPPER_M)).all(axis=1)]
    around = ObstaclePoints.of([points]).around_box(T_world_box, LOWER_M, UPPER_M)
    found = around[((around > LOWER_M) & (around < UPPER_M)).all(axis=1)]
    assert 0 < len(inside) == len(found) and len(around) < len(points) / 2
    np.testing.assert_allclose(np.sort(inside[:, 2]), np.sort(found[:, 2]), atol=1e-12)


def test_below_a_box_that_points_down_there_is_nothing() -> None:
    points = ObstaclePoints.of([np.random.default_rng(0).uniform(-0.1, 0.0, (100, 3))])
    above = transform(so3_exp(np.array([np.pi, 0.0, 0.0])), np.array([0.0, 0.0, 0.2]))
    around = points.around_box(above, LOWER_M, UPPER_M)
    assert not ((around > LOWER_M) & (around < UPPER_M)).all(axis=1).any()


def test_chosen_points_stay_in_order_and_keep_their_owners() -> None:
    clouds = list(np.random.default_rng(0).normal(size=(3, 50, 3)))
    obstacles = ObstaclePoints.of(clouds).of_owners({0, 2})
    assert (np.diff(obstacles.columns_m[1]) >= 0).all() and obstacles.top_m == obstacles.columns_m[2].max()
    for owner, count in ((0, 50), (1, 0), (2, 50)):
        own = obstacles.columns_m[:, obstacles.owners == owner]
        assert own.shape[1] == count
        if count:
            np.testing.assert_array_equal(own.T, clouds[owner][np.argsort(clouds[owner][:, 1])])


def test_points_of_one_part_can_be_left_out() -> None:
    clouds = list(np.random.default_rng(0).uniform(-0.04, 0.0, (3, 60, 3)))
    around = ObstaclePoints.of(clouds).around_box(np.eye(4), np.full(3, -1.0), np.ones(3), beside=1)
    expected = np.concatenate([clouds[0], clouds[2]])
    np.testing.assert_array_equal(around, expected[np.argsort(expected[:, 1])])
