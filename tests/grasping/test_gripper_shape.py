"""`GripperShape` counts what lies in the gripper's boxes, and is made again for another opening only."""

import numpy as np
import pytest

from simpick.assets.grippers import get_gripper
from simpick.assets.grippers.sampling.boxes import box_surface_points, points_in_boxes, swept_back
from simpick.grasping import GraspPlanner
from simpick.grasping.gripper_shape import GripperShape
from simpick.scene.config import BinConfig

APPROACH_M, CLEARANCE_M = 0.08, 0.001


@pytest.mark.parametrize(("kind", "opening_m"), [("jaw", 0.02), ("jaw", 0.06), ("suction", 0.0)])
def test_points_met_are_those_in_the_boxes(kind: str, opening_m: float) -> None:
    gripper, rng = get_gripper(kind), np.random.default_rng(0)
    shape = GripperShape.of(gripper, opening_m, APPROACH_M, CLEARANCE_M)
    boxes, gripped = gripper.boxes(opening_m), gripper.grip_boxes(opening_m)
    np.testing.assert_array_equal(shape.edges, box_surface_points(boxes))
    met = []
    for _ in range(200):
        points = rng.uniform([-0.08, -0.03, -0.31], [0.08, 0.03, 0.02], (4, 3))
        swept = int(points_in_boxes(points, swept_back(boxes, APPROACH_M), CLEARANCE_M).sum())
        met.append((swept, bool(points_in_boxes(points, gripped).any())))
        assert shape.points_met(points) == met[-1]
        inside = points_in_boxes(points, swept_back(boxes, APPROACH_M), CLEARANCE_M)
        for back_m in (-0.5, -0.12, -0.05, 0.5):
            lower_m, upper_m = shape.around_from(back_m)
            reached = points[inside & (points[:, 2] > back_m)]
            assert ((reached > lower_m) & (reached < upper_m)).all()
    assert len(set(met)) > 2


def test_only_the_fingers_are_around_a_tcp_low_in_a_pile() -> None:
    shape = GripperShape.of(get_gripper("jaw"), 0.02, APPROACH_M, CLEARANCE_M)
    lower_m, upper_m = shape.around_from(-0.10)
    np.testing.assert_allclose(upper_m, [0.01 + 0.0085 + CLEARANCE_M, 0.01 + CLEARANCE_M, 0.01 + CLEARANCE_M])
    np.testing.assert_allclose(lower_m[:2], -upper_m[:2])
    assert shape.around_from(-0.5)[1][0] == pytest.approx(0.062 + CLEARANCE_M)


def test_each_opening_has_its_own_shape_that_nothing_can_change() -> None:
    planner = GraspPlanner("jaw", BinConfig())
    narrow, wide = planner._shape(0.02), planner._shape(0.06)
    assert narrow is planner._shape(0.02) and narrow is not wide
    for opening_m, shape in ((0.02, narrow), (0.06, wide)):
        fresh = GripperShape.of(planner.gripper, opening_m, APPROACH_M, CLEARANCE_M)
        np.testing.assert_array_equal(shape.corners, fresh.corners)
        np.testing.assert_array_equal(shape.edges, fresh.edges)
    with pytest.raises(ValueError, match="read-only"):
        narrow.corners[0] = 0.0
