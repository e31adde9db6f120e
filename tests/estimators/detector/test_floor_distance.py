"""Distances to the bin's floor, and frames that do not say where it is."""

import numpy as np
import pytest

from simpick.estimators.detector.floor_distance import floor_distances
from simpick.geometry import Pinhole, look_at
from simpick.records import CameraFrame

SIGHTS = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, np.sqrt(0.91)], [0.0, 0.2, np.sqrt(0.96)]])


def frame_at(T_world_camera: np.ndarray) -> CameraFrame:
    return CameraFrame(np.zeros((48, 64, 3), np.uint8), Pinhole.from_fovy(64, 48, 30.0), T_world_camera)


def test_lines_of_sight_end_on_the_floor() -> None:
    T = look_at(np.array([0.1, 0.2, 0.9]), np.array([0.4, 0.3, 0.0]))
    distances = floor_distances(frame_at(T), SIGHTS)
    assert distances is not None
    ends = T[:3, 3] + distances[:, None] * (SIGHTS @ T[:3, :3].T)
    np.testing.assert_allclose(ends[:, 2], 0, atol=1e-9)


@pytest.mark.parametrize(
    "T_world_camera",
    [
        np.eye(4),
        look_at(np.array([0.0, 0.0, -0.5]), np.array([0.1, 0.0, -1.0])),
        look_at(np.array([0.0, 0.0, 0.5]), np.array([1.0, 0.0, 0.5])),
    ],
    ids=["identity", "below the floor", "horizontal"],
)
def test_some_frames_do_not_say_where_the_floor_is(T_world_camera: np.ndarray) -> None:
    assert floor_distances(frame_at(T_world_camera), SIGHTS) is None
