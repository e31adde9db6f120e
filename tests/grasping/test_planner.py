from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from simpick.assets.grippers.sampling.boxes import box_surface_points, points_in_boxes
from simpick.assets.library import get_part
from simpick.errors import ConfigError
from simpick.geometry.transforms import invert, so3_exp, transform, transform_points
from simpick.grasping import FailureMemory, GraspPlanner, PlannerConfig, Rejection, View
from simpick.grasping.coverage import resting_coverage
from simpick.grasping.exposure import exposures
from simpick.scene.config import BinConfig


def lying(x_m: float = 0.5, y_m: float = 0.0, z_m: float = 0.008, yaw_rad: float = 0.3) -> np.ndarray:
    """Return a hex nut (16 mm high) flat on the bin's floor, or higher up."""
    return transform(so3_exp(np.array([0, 0, yaw_rad])), np.array([x_m, y_m, z_m]))


NUT = get_part("hex_nut")


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner("jaw", BinConfig())


@pytest.fixture(scope="module")
def suction() -> GraspPlanner:
    return GraspPlanner("suction", BinConfig())


def test_grasps_of_a_lone_part_keep_off_floor_and_walls(planner: GraspPlanner) -> None:
    for T_world_part in (lying(), lying(x_m=0.50 - 0.15 + 0.022)):
        grasps = planner.plan([NUT], [T_world_part])
        assert grasps
        for grasp in grasps:
            points = transform_points(grasp.T_world_tcp, box_surface_points(planner.gripper.boxes(grasp.opening_m)))
            assert points[:, 2].min() > 0
            low = points[points[:, 2] < 0.12]
            assert (np.abs(low[:, :2] - [0.5, 0.0]) < [0.15, 0.20]).all()


@pytest.mark.parametrize(("axis", "side"), [(0, -1), (0, 1), (1, -1), (1, 1)])
def test_each_wall_is_given_its_clearance(planner: GraspPlanner, axis: int, side: int) -> None:
    centre, half = np.array([0.5, 0.0]), np.array([0.15, 0.20])
    place = centre.copy()
    place[axis] += side * (half[axis] - 0.030)
    careful = GraspPlanner("jaw", BinConfig(), PlannerConfig(wall_clearance_m=0.012))

    def least_gap_m(grasp) -> float:
        points = transform_points(grasp.T_world_tcp, box_surface_points(planner.gripper.boxes(grasp.opening_m)))
        low = points[points[:, 2] < 0.12]
        return float((half[axis] - side * (low[:, axis] - centre[axis])).min())

    usual, wide = (p.plan([NUT], [lying(*place)]) for p in (planner, careful))
    assert usual and min(map(least_gap_m, usual)) < 0.012, "the wall is near enough to matter"
    assert min(map(least_gap_m, usual)) >= 0.0015
    assert wide and min(map(least_gap_m, wide)) >= 0.012


def test_a_part_beneath_the_fingertips_is_in_nobody_s_way(planner: GraspPlanner) -> None:
    block = get_part("terminal_block")
    beneath = transform(translation=np.array([0.5, 0.0, 0.0125]))
    alone = planner.plan([NUT], [lying(z_m=0.08)])
    found = [g for g in planner.plan([NUT, block], [lying(z_m=0.08), beneath]) if g.target == 0]
    assert found[0].quality == pytest.approx(alone[0].quality)


def test_a_part_that_the_pads_would_take_along_rules_a_grasp_out(planner: GraspPlanner) -> None:
    # The upper nut stands exactly over the lower: no finger meets it, but the pads would close on both.
    targets = {grasp.target for grasp in planner.plan([NUT, NUT], [lying(), lying(z_m=0.025)])}
    assert targets == {1}


@pytest.mark.parametrize("largest_deg", [10.0, 35.0])
def test_no_grasp_is_steeper_than_the_limit(largest_deg: float) -> None:
    leaning = lying(z_m=0.05) @ transform(so3_exp(np.radians([25.0, 0.0, 0.0])))
    usual = GraspPlanner("jaw", BinConfig(), PlannerConfig(grasps_per_target=300))
    strict = GraspPlanner("jaw", BinConfig(), PlannerConfig(largest_tilt_deg=largest_deg, grasps_per_target=300))

    def tilt_deg(grasp) -> float:
        return float(np.degrees(np.arccos(-grasp.T_world_tcp[2, 2])))

    rejected: Counter[Rejection] = Counter()
    kept = list(strict.search([NUT], [leaning], rejected=rejected))
    assert max(map(tilt_deg, usual.plan([NUT], [leaning]))) > largest_deg
    assert kept and max(map(tilt_deg, kept)) < largest_deg
    assert rejected[Rejection.TILT] > 0


def test_grasps_are_ordered_and_come_from_above(planner: GraspPlanner) -> None:
    grasps = planner.plan([NUT, NUT], [lying(), lying(y_m=0.1)])
    assert {grasp.target for grasp in grasps} == {0, 1}
    assert all(a.quality >= b.quality for a, b in pairwise(grasps))
    assert all(-grasp.T_world_tcp[2, 2] > np.cos(np.radians(50.1)) for grasp in grasps)


def test_a_grasp_is_the_parts_pose_times_its_grasp(suction: GraspPlanner) -> None:
    T_world_part = transform(so3_exp(np.array([np.pi / 2, 0, 0])), np.array([0.5, 0.0, 0.016]))
    best = suction.plan([NUT], [T_world_part])[0]
    np.testing.assert_allclose(best.T_world_tcp, T_world_part @ best.grasp.T_part_tcp, atol=1e-9)
    assert best.opening_m == 0.0


def test_the_best_grasp_keeps_clear_of_a_neighbour(planner: GraspPlanner) -> None:
    block = get_part("terminal_block")
    T_world_block = transform(translation=np.array([0.5, 0.045, 0.0125]))
    best = next(g for g in planner.plan([NUT, block], [lying(), T_world_block]) if g.target == 0)
    seen = transform_points(invert(best.T_world_tcp) @ T_world_block, np.asarray(block.mesh.sample(3000, seed=1)))
    assert not points_in_boxes(seen, planner.gripper.boxes(best.opening_m)).any()


def test_the_part_on_top_comes_before_the_one_beneath(planner: GraspPlanner) -> None:
    grasps = planner.plan([NUT, NUT], [lying(), lying(x_m=0.51, z_m=0.024)])
    assert grasps[0].target == 1


def test_a_surer_estimate_comes_first(planner: GraspPlanner) -> None:
    parts, poses = [NUT, NUT], [lying(y_m=-0.1), lying(y_m=0.1)]
    assert planner.plan(parts, poses, scores=[0.3, 0.9])[0].target == 1
    assert planner.plan(parts, poses, scores=[0.9, 0.3])[0].target == 0


def test_an_empty_bin_offers_nothing(planner: GraspPlanner) -> None:
    assert planner.plan([], []) == []


def test_a_part_under_the_floor_offers_nothing(planner: GraspPlanner) -> None:
    assert planner.plan([NUT], [lying(z_m=-0.05)]) == []


def test_a_failed_grasp_is_not_chosen_again(planner: GraspPlanner) -> None:
    memory = FailureMemory()
    first = planner.plan([NUT], [lying()], memory=memory)[0]
    memory.remember(NUT, lying(), first.T_world_tcp)
    second = planner.plan([NUT], [lying()], memory=memory)[0]
    assert np.linalg.norm(second.T_world_tcp - first.T_world_tcp) > 0.01
    assert second.quality < first.quality


def test_failures_make_another_part_come_first(planner: GraspPlanner) -> None:
    parts, poses = [NUT, NUT], [lying(y_m=-0.1), lying(y_m=0.1)]
    memory = FailureMemory()
    first = planner.plan(parts, poses, memory=memory)[0]
    memory.remember(NUT, poses[first.target], first.T_world_tcp)
    assert planner.plan(parts, poses, memory=memory)[0].target != first.target


def test_a_failure_is_forgotten_when_its_part_has_moved_or_the_episode_ends() -> None:
    memory = FailureMemory()
    T_world_tcp = lying()[None]
    memory.remember(NUT, lying(), T_world_tcp[0])
    assert memory.factors(NUT, lying(), T_world_tcp) < 0.1
    assert memory.factors(NUT, lying(x_m=0.52), T_world_tcp) == 1
    assert memory.factors(get_part("bushing"), lying(), T_world_tcp) == 1
    memory.forget()
    assert len(memory) == 0 and memory.factors(NUT, lying(), T_world_tcp) == 1


@pytest.mark.parametrize("name", ["hex_nut", "z_bracket", "bushing"])
def test_a_failure_is_remembered_although_looks_differ_and_flip(planner: GraspPlanner, name: str) -> None:
    part, rng = get_part(name), np.random.default_rng(0)
    height = part.diameter_m / 2
    poses = [transform(so3_exp(np.array([0.0, 0.0, 0.4])), np.array([0.5, y, height])) for y in (-0.09, 0.09)]
    group = part.symmetries.transforms(24)
    for _ in range(5):
        memory = FailureMemory()

        def look(T: np.ndarray) -> np.ndarray:
            turned = T @ group[rng.integers(len(group))]
            turned[:3, :3] = so3_exp(np.radians(3) * rng.normal(size=3) / 1.5) @ turned[:3, :3]
            turned[:3, 3] += 0.003 * rng.normal(size=3) / 1.5
            return turned

        seen = [look(T) for T in poses]
        first = planner.plan([part, part], seen, memory=memory)[0]
        memory.remember(part, seen[first.target], first.T_world_tcp)
        again = planner.plan([part, part], [look(T) for T in poses], memory=memory)[0]
        assert again.target != first.target
        # Nothing else is left: the same part again, but held elsewhere.
        alone = planner.plan([part], [look(poses[first.target])], memory=memory)[0]
        offset = np.linalg.norm(alone.T_world_tcp[:3, 3] - first.T_world_tcp[:3, 3])
        turn = np.arccos(np.clip((np.trace(alone.T_world_tcp[:3, :3].T @ first.T_world_tcp[:3, :3]) - 1) / 2, -1, 1))
        assert offset > 0.008 or np.degrees(min(turn, abs(np.pi - turn))) > 10


def view_of(rgb: np.ndarray) -> View:
    """Return the view of a part in the middle of an image of 60 x 80 px."""
    outline = np.zeros((60, 80), bool)
    outline[25:35, 35:45] = True
    return View.of(rgb, outline)


def test_a_pose_at_which_the_gripper_closed_on_nothing_is_ruled_out(planner: GraspPlanner) -> None:
    memory = FailureMemory()
    memory.remember(NUT, lying(), planner.plan([NUT], [lying()])[0].T_world_tcp, missed=True)
    tilted = lying() @ transform(so3_exp(np.array([0.6, 0.0, 0.0])))
    assert memory.is_ruled_out(NUT, lying(yaw_rad=0.35))
    assert not memory.is_ruled_out(NUT, tilted) and not memory.is_ruled_out(NUT, lying(x_m=0.55))
    rejected: Counter[Rejection] = Counter()
    assert not list(planner.search([NUT], [lying()], memory=memory, rejected=rejected))
    assert rejected[Rejection.FAILED] > 0
    assert planner.plan([NUT], [lying(x_m=0.55)], memory=memory)


def test_a_grasp_that_failed_is_ruled_out_until_the_image_changes_around_the_part(planner: GraspPlanner) -> None:
    before = np.full((60, 80, 3), 90, np.uint8)
    elsewhere, here = before.copy(), before.copy()
    elsewhere[:10], here[36:40, 35:45] = 200, 200
    grasp = planner.plan([NUT], [lying()])[0].T_world_tcp
    memory = FailureMemory()
    memory.remember(NUT, lying(), grasp, view=view_of(before))
    memory.remember(NUT, lying(), grasp, missed=True, view=view_of(before))
    for image in (before, elsewhere):
        memory.look(image)
        assert memory.factors(NUT, lying(), grasp[None]) == 0 and memory.is_ruled_out(NUT, lying())
    memory.look(here)
    assert 0 < memory.factors(NUT, lying(), grasp[None]) < 0.001 and not memory.is_ruled_out(NUT, lying())
    # What has changed stays changed.
    memory.look(before)
    assert not memory.is_ruled_out(NUT, lying())


def test_noise_of_the_image_is_no_change() -> None:
    rng = np.random.default_rng(0)
    images = [np.clip(rng.normal(90, 4, (60, 80, 3)), 0, 255).astype(np.uint8) for _ in range(2)]
    assert not view_of(images[0]).differs_from(images[1])


def test_rejected_grasps_are_counted_by_reason(planner: GraspPlanner) -> None:
    rejected: Counter[Rejection] = Counter()
    wall = lying(x_m=0.5 - 0.15 + 0.004)
    list(planner.search([NUT, NUT], [wall, lying(y_m=0.1)], rejected=rejected))
    assert rejected[Rejection.TILT] > 0 and rejected[Rejection.BIN] > 0
    assert rejected[Rejection.FAILED] == rejected[Rejection.REACH] == 0


def test_the_first_grasp_of_a_search_is_the_first_of_the_plan(planner: GraspPlanner) -> None:
    parts, poses = [NUT] * 3, [lying(y_m=-0.1), lying(), lying(x_m=0.51, z_m=0.024)]
    assert next(planner.search(parts, poses)).quality == planner.plan(parts, poses)[0].quality


def test_any_other_part_is_preferred_to_one_that_failed(planner: GraspPlanner) -> None:
    parts, poses, scores = [NUT, NUT], [lying(y_m=-0.1), lying(y_m=0.1)], [0.95, 0.2]
    memory = FailureMemory()
    first = planner.plan(parts, poses, scores=scores, memory=memory)[0]
    assert first.target == 0
    memory.remember(NUT, poses[0], first.T_world_tcp)
    assert planner.plan(parts, poses, scores=scores, memory=memory)[0].target == 1


def test_exposure_is_the_uncovered_share() -> None:
    grid = np.stack(np.meshgrid(np.arange(0, 0.04, 0.002), np.arange(0, 0.04, 0.002)), axis=-1).reshape(-1, 2)
    flat = np.pad(grid, ((0, 0), (0, 1)))
    lid = flat[flat[:, 0] < 0.02] + [0, 0, 0.01]
    below, above = exposures([flat, lid])
    assert above == 1.0 and below == pytest.approx(0.5, abs=0.06)


def test_a_part_far_outside_the_bin_offers_nothing_and_is_in_nobody_s_way(planner: GraspPlanner) -> None:
    alone = planner.plan([NUT], [lying()])
    found = planner.plan([NUT, NUT, NUT], [lying(), lying(x_m=60.0), lying(y_m=-60.0)])
    assert [g.quality for g in found] == [g.quality for g in alone]


def test_same_input_same_plan(planner: GraspPlanner) -> None:
    first = planner.plan([NUT], [lying()])
    again = GraspPlanner("jaw", BinConfig()).plan([NUT], [lying()])
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a.T_world_tcp, b.T_world_tcp)


@pytest.mark.parametrize(
    ("name", "kind"), [("z_bracket", "jaw"), ("tri_flange", "jaw"), ("z_bracket", "suction"), ("snap_clip", "suction")]
)
def test_parts_can_be_picked_however_they_rest(name: str, kind: str) -> None:
    assert resting_coverage(get_part(name), kind) > 0.97


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"largest_tilt_deg": 0.0}, "largest_tilt_deg must be above 0 and at most 90, got 0.0"),
        ({"side_clearances_m": ()}, r"side_clearances_m must be of length at least 1, got \(\)"),
        ({"most_back_off_m": 0.0}, "most_back_off_m must be above 0, got 0.0"),
        ({"grasps_per_target": 0}, "grasps_per_target must be at least 1, got 0"),
    ],
)
def test_bad_settings_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        PlannerConfig(**settings)
