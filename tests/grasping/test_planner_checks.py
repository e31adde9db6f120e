"""What the planner scores, counts and checks, against the same computed in another way."""

from collections import Counter

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry import Pinhole, look_at
from simpick.geometry.transforms import so3_exp, transform, transform_points
from simpick.grasping import FailureMemory, GraspPlanner, PlannerConfig, Rejection, UnexplainedSpace
from simpick.grasping.obstacle_points import ObstaclePoints
from simpick.grasping.part_grasps import symmetric_grasps
from simpick.scene.config import BinConfig

NUT = get_part("hex_nut")
ALL = PlannerConfig(grasps_per_target=500, tries_per_target=2000)
OPENING_M = 0.04
SECOND_M = ALL.side_clearances_m[1]


def lying(x_m: float = 0.5, y_m: float = 0.0, z_m: float = 0.008) -> np.ndarray:
    """Return a hex nut (16 mm high) flat on the bin's floor, or higher up."""
    return transform(so3_exp(np.array([0, 0, 0.3])), np.array([x_m, y_m, z_m]))


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner("jaw", BinConfig(), ALL)


def test_the_quality_is_that_of_the_grasp_by_tilt_and_opening(planner: GraspPlanner) -> None:
    # In the air, so that no grasp is drawn back from the floor; alone, so that it is exposed and on top; near a wall.
    found = planner.plan([NUT], [lying(x_m=0.383, z_m=0.08)])
    assert len({g.opening_m - g.grasp.width_m > 2 * SECOND_M + 1e-9 for g in found}) == 2, "both clearances are used"
    for grasp in found:
        choice = min((0, 1), key=lambda k: abs(grasp.grasp.width_m + 2 * ALL.side_clearances_m[k] - grasp.opening_m))
        assert grasp.opening_m == pytest.approx(grasp.grasp.width_m + 2 * ALL.side_clearances_m[choice])
        descent = -grasp.T_world_tcp[2, 2]
        assert grasp.quality == pytest.approx(grasp.grasp.quality * descent**2 * 0.8**choice)


def test_grasps_that_are_too_steep_or_failed_are_counted_for_all_parts(planner: GraspPlanner) -> None:
    parts, poses = [NUT, NUT], [lying(y_m=-0.1), lying(y_m=0.1)]
    tilts = [-(T @ g.T_part_tcp)[2, 2] for T in poses for g in symmetric_grasps(NUT, "jaw")]
    steep = sum(bool(descent <= np.cos(np.radians(ALL.largest_tilt_deg))) for descent in tilts)
    memory, rejected = FailureMemory(), Counter()
    for T in poses:
        memory.remember(NUT, T, T, missed=True)
    list(planner.search(parts, poses, memory=memory, rejected=rejected))
    assert rejected == Counter({Rejection.TILT: steep, Rejection.FAILED: len(tilts) - steep})


def test_a_part_without_grasps_offers_nothing_and_is_in_the_way_of_others(monkeypatch: pytest.MonkeyPatch) -> None:
    block = get_part("terminal_block")
    monkeypatch.setattr(
        "simpick.grasping.planner.symmetric_grasps",
        lambda part, gripper: [] if part is block else symmetric_grasps(part, gripper),
    )
    own, T_block = GraspPlanner("jaw", BinConfig(), ALL), transform(translation=np.array([0.5, 0.045, 0.0125]))
    assert own.plan([block], [T_block]) == []
    found = own.plan([NUT, block], [lying(), T_block])
    assert found and {g.target for g in found} == {0}
    assert len(found) < len(own.plan([NUT], [lying()]))


def test_planners_agree_on_parts_that_hide_one_another() -> None:
    parts, poses = [NUT] * 3, [lying(), lying(x_m=0.512, z_m=0.024), lying(y_m=0.04)]
    first, again = ([g.quality for g in GraspPlanner("jaw", BinConfig()).plan(parts, poses)] for _ in range(2))
    assert first == again


def test_suction_below_the_floor_is_refused() -> None:
    suction = GraspPlanner("suction", BinConfig(), ALL)
    assert suction.plan([NUT], [lying()]) and not suction.plan([NUT], [lying(z_m=-0.05)])


def test_doubt_grows_with_what_is_met() -> None:
    camera = Pinhole(320, 240, 480.0, 480.0, 160.0, 120.0)
    T_world_camera = look_at(np.array([0.5, 0.0, 0.9]), np.array([0.5, 0.0, 0.0]))
    everywhere, nothing = np.ones((240, 320), bool), np.zeros((240, 320), bool)
    space = UnexplainedSpace(camera, T_world_camera, everywhere, (nothing,), frozenset({0}), 0.05)
    quality = {}
    for points in (1e-6, 1e9):
        own = GraspPlanner("jaw", BinConfig(), PlannerConfig(unexplained_points=points))
        alone = own.plan([NUT], [lying()])[0].quality
        quality[points] = next(own.search([NUT], [lying()], unexplained=space)).quality / alone
    assert quality[1e9] == pytest.approx(1.0, abs=1e-4)
    assert quality[1e-6] == pytest.approx(PlannerConfig().unexplained_factor)


def test_the_approach_must_be_free_midway_too(planner: GraspPlanner) -> None:
    leaning = so3_exp(np.radians([0.0, -135.0, 0.0]))  # The approach comes from the right (x) and from above.
    tcp = np.zeros((1, 3))

    def is_free(gap_m: float, z_m: float) -> bool:
        return planner._clears_bin(transform(leaning, np.array([0.65 - gap_m, 0.0, z_m])), tcp)

    assert leaning[0, 2] < 0 and leaning[2, 2] < 0
    # 40 mm back it is 8 mm beyond the wall and below the rim; 80 mm back it is above the rim.
    assert not is_free(0.020, 0.070)
    assert is_free(0.035, 0.070) and is_free(0.020, 0.100)


@pytest.mark.parametrize(("over_rim_m", "is_free"), [(-0.001, False), (0.001, False), (0.002, True)])
def test_above_the_walls_the_clearance_is_kept_as_well(planner: GraspPlanner, over_rim_m: float, is_free: bool) -> None:
    T = transform(so3_exp(np.array([np.pi, 0, 0])), np.array([0.66, 0.0, 0.12 + over_rim_m]))
    assert planner._clears_bin(T, np.zeros((1, 3))) == is_free


@pytest.mark.parametrize(
    ("point_mm", "touched"),
    [
        ((0.0, 0.0, 10.5), 0),  # Between the fingers, in front of what they close on.
        ((24.0, 0.0, 10.5), 1),  # Half a millimetre in front of a fingertip.
        ((24.0, 0.0, 12.0), 0),
        ((29.0, 0.0, 0.0), 1),  # Half a millimetre beside a finger.
        ((30.0, 0.0, 0.0), 0),
        ((62.5, 0.0, -140.0), 1),  # Beside the palm, the widest of all.
        ((63.5, 0.0, -140.0), 0),
        ((0.0, 25.5, -140.0), 1),
        ((50.0, 0.0, -290.0), 1),  # Where the palm is 75 mm before the grasp.
        ((50.0, 0.0, -297.0), 0),
        ((0.0, 0.0, 5.0), PlannerConfig().most_points_touched + 1),  # The jaw would take it along.
    ],
)
def test_what_is_in_the_way_is_counted_with_its_clearance(
    planner: GraspPlanner, point_mm: tuple[float, ...], touched: int
) -> None:
    T = lying(z_m=0.3)
    obstacle = ObstaclePoints.of([transform_points(T, np.array([point_mm]) / 1e3)])
    assert planner._touched(T, planner._shape(OPENING_M), obstacle, target=1) == touched


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("x_mm", "y_mm", "touched"), [(62.5, 0.0, 1), (63.5, 0.0, 0), (0.0, 25.5, 1), (0.0, 26.5, 0)])
def test_what_is_beside_the_palm_is_counted_where_its_sides_are_parallel_to_the_world_s(
    planner: GraspPlanner, side: float, x_mm: float, y_mm: float, touched: int
) -> None:
    T = transform(translation=np.array([0.5, 0.0, 0.3]))
    obstacle = ObstaclePoints.of([transform_points(T, side * np.array([[x_mm, y_mm, side * -140.0]]) / 1e3)])
    assert planner._touched(T, planner._shape(OPENING_M), obstacle, target=1) == touched


def test_in_the_way_may_be_all_points_of_other_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    own, seen = GraspPlanner("jaw", BinConfig()), []
    monkeypatch.setattr(own, "_touched", lambda T, shape, obstacles, target: seen.append((obstacles, target)) or 0)
    poses = [lying(z_m=0.2), lying(x_m=0.55, y_m=0.02), lying(y_m=-0.05)]
    assert next(own.search([NUT] * 3, poses, scores=[0.9, 0.5, 0.5])).target == 0
    (obstacles, target), *_ = seen
    around = obstacles.around_box(np.eye(4), np.full(3, -1.0), np.ones(3), beside=target)
    expected = np.concatenate([transform_points(T, own._points[NUT.content_hash]) for T in poses[1:]])
    np.testing.assert_array_equal(around, expected[np.argsort(expected[:, 1])])
