"""Boxes of a gripper, their sweep along the approach, and the points that decide what they meet."""

import numpy as np
import pytest

from simpick.assets.grippers.sampling.boxes import box_surface_points, points_in_boxes, swept_back

BOXES = np.array([[[-0.03, -0.01, -0.04], [-0.02, 0.01, 0.01]], [[0.02, -0.01, -0.04], [0.03, 0.01, 0.01]]])


def test_the_sweep_covers_what_the_approach_passes_and_nothing_beyond_the_tips() -> None:
    swept = swept_back(BOXES, 0.05)
    passed, beyond = np.array([[0.025, 0.0, -0.08]]), np.array([[0.025, 0.0, 0.02]])
    assert not points_in_boxes(passed, BOXES).any()
    assert points_in_boxes(passed, swept).all()
    assert not points_in_boxes(beyond, swept).any()
    np.testing.assert_allclose(swept[:, 1], BOXES[:, 1])
    np.testing.assert_allclose(BOXES[:, 0, 2], -0.04, err_msg="the boxes given are not changed")


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [0, 1])
def test_a_margin_grows_each_face_outwards(axis: int, side: int) -> None:
    point = BOXES[1].mean(axis=0)
    point[axis] = BOXES[1, side, axis] + (0.001 if side else -0.001)
    assert not points_in_boxes(point[None], BOXES[1:]).any()
    assert points_in_boxes(point[None], BOXES[1:], margin_m=0.002).all()
    assert not points_in_boxes(point[None], BOXES[1:], margin_m=0.0005).any()


def test_the_space_between_two_boxes_is_in_neither() -> None:
    assert not points_in_boxes(np.zeros((1, 3)), BOXES).any()


def test_surface_points_reach_each_corner_and_leave_no_long_gap() -> None:
    points = box_surface_points(BOXES, spacing_m=0.012)
    for box in BOXES:
        for x in box[:, 0]:
            for y in box[:, 1]:
                heights = np.sort(points[(points[:, 0] == x) & (points[:, 1] == y), 2])
                assert (heights[0], heights[-1]) == (box[0, 2], box[1, 2])
                assert np.diff(heights).max() <= 0.012
