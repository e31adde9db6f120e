"""Farthest points."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.geometry import farthest_points


def test_farthest_points_of_a_box_are_its_corners() -> None:
    rng = np.random.default_rng(0)
    corners = np.array(np.meshgrid([-1.0, 1], [-1.0, 1], [-1.0, 1])).reshape(3, -1).T
    points = np.concatenate([rng.uniform(-0.5, 0.5, (100, 3)), corners])
    assert set(farthest_points(points, 8)) == set(range(100, 108))


def test_all_points_are_chosen_once() -> None:
    points = np.random.default_rng(0).normal(size=(20, 3))
    assert sorted(farthest_points(points, 20)) == list(range(20))


@pytest.mark.parametrize("count", [0, 4])
def test_farthest_points_count_is_checked(count: int) -> None:
    with pytest.raises(ConfigError, match=f"between 1 and 3, got {count}"):
        farthest_points(np.eye(3), count)
