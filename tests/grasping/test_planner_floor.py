"""A jaw's fingertips keep off the floor: the grasp is drawn back along its approach, and worth less for it."""

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import so3_exp, transform
from simpick.grasping import GraspPlanner, PlannerConfig
from simpick.records import Grasp
from simpick.scene.config import BinConfig

CLEARANCE_M = PlannerConfig().floor_clearance_m + 1e-6
MOST_M = PlannerConfig().most_back_off_m
TIP = np.zeros((1, 3))


def approach(z_m: float, tilt_rad: float = 0.0) -> np.ndarray:
    """Return a TCP in the middle of the bin at this height, that far from straight down."""
    return transform(so3_exp(np.array([np.pi - tilt_rad, 0.0, 0.0])), np.array([0.5, 0.0, z_m]))


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner("jaw", BinConfig())


@pytest.mark.parametrize("tilt_rad", [0.0, 0.6, -0.6])
def test_a_grasp_is_drawn_back_along_its_approach_until_it_is_off_the_floor(
    planner: GraspPlanner, tilt_rad: float
) -> None:
    T = approach(0.0003, tilt_rad)
    before = T.copy()
    drawn_back, back_m = planner._off_the_floor(T, TIP)
    assert back_m == pytest.approx((CLEARANCE_M - 0.0003) / np.cos(tilt_rad), abs=1e-9)
    assert drawn_back[2, 3] == pytest.approx(CLEARANCE_M, abs=1e-9)
    np.testing.assert_allclose(T[:3, 3] - drawn_back[:3, 3], back_m * T[:3, 2], atol=1e-12)
    np.testing.assert_array_equal(drawn_back[:3, :3], T[:3, :3])
    np.testing.assert_array_equal(T, before)


def test_the_lowest_point_counts(planner: GraspPlanner) -> None:
    back_m = planner._off_the_floor(approach(0.010), np.array([[0.0, 0.0, -0.05], [0.0, 0.0, 0.0105], TIP[0]]))[1]
    assert back_m == pytest.approx(CLEARANCE_M + 0.0005, abs=1e-9)


def test_a_grasp_above_the_floor_stays(planner: GraspPlanner) -> None:
    T, back_m = planner._off_the_floor(approach(0.001, 0.6), TIP)
    assert back_m == 0
    np.testing.assert_array_equal(T, approach(0.001, 0.6))


def test_a_gripper_that_is_pressed_on_stays() -> None:
    T, back_m = GraspPlanner("suction", BinConfig())._off_the_floor(approach(0.0003), TIP)
    assert back_m == 0
    np.testing.assert_array_equal(T, approach(0.0003))


@pytest.mark.parametrize(("back_share", "worth"), [(0.0, 1.0), (0.5, 0.75), (0.99, 0.505), (1.01, None)])
def test_the_further_back_the_less_a_grasp_is_worth(
    planner: GraspPlanner, monkeypatch: pytest.MonkeyPatch, back_share: float, worth: float | None
) -> None:
    nut = get_part("hex_nut")
    lowest_m = -float(planner.gripper.boxes(0.026)[:, 1, 2].max())  # Below the TCP, where the approach is down.
    down = approach(CLEARANCE_M - lowest_m - back_share * MOST_M)
    part = transform(translation=np.array([0.5, 0.0, 0.008]))
    grasp = Grasp(np.linalg.inv(part) @ down, 0.014, 0.8)
    monkeypatch.setattr("simpick.grasping.planner.symmetric_grasps", lambda part, gripper: [grasp])
    found = GraspPlanner("jaw", BinConfig()).plan([nut], [part])
    assert [g.quality for g in found] == ([] if worth is None else [pytest.approx(0.8 * worth, abs=1e-6)])
    for g in found:
        assert g.T_world_tcp[2, 3] == pytest.approx(CLEARANCE_M - lowest_m, abs=1e-9)
