"""Grasps are tested one at a time, yet come in the order of testing all; earlier searches change nothing."""

from collections import Counter

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import so3_exp, transform
from simpick.grasping import GraspPlanner, Rejection
from simpick.grasping.obstacle_points import ObstaclePoints
from simpick.grasping.planner import WorldGrasp
from simpick.scene.config import BinConfig

NAMES = ("hex_nut", "z_bracket", "bushing", "spur_gear", "clevis_pin")


def heap(seed: int, count: int = 14) -> tuple[list, list[np.ndarray]]:
    """Return parts and poses of a heap in the middle of the bin, in which many grasps meet other parts."""
    rng = np.random.default_rng(seed)
    parts = [get_part(NAMES[k % len(NAMES)]) for k in range(count)]
    places = rng.uniform([0.42, -0.09, 0.01], [0.58, 0.09, 0.07], (count, 3))
    return parts, [transform(so3_exp(rng.uniform(-2, 2, 3)), place) for place in places]


def of_target(planner: GraspPlanner, target, obstacles: ObstaclePoints) -> list[WorldGrasp]:
    """Return the grasps of one part after testing each that may count."""
    free: list[WorldGrasp] = []
    touching: list[WorldGrasp] = []
    for rank in range(len(target.order)):
        found, brushing, _ = planner._tried(target, rank, obstacles, np.zeros((0, 3)))
        touching += brushing
        free += [] if found is None else [found]
        if len(free) == planner.config.grasps_per_target:
            break
    return free or sorted(touching, key=lambda g: -g.quality)[: planner.config.grasps_per_target]


@pytest.mark.parametrize("kind", ["jaw", "suction"])
@pytest.mark.parametrize("seed", range(4))
def test_the_order_is_that_of_testing_all_grasps(kind: str, seed: int) -> None:
    planner, (parts, poses) = GraspPlanner(kind, BinConfig()), heap(seed)
    found = planner.plan(parts, poses)
    clouds = [T[:3, 3] + planner._points[p.content_hash] @ T[:3, :3].T for p, T in zip(parts, poses, strict=True)]
    weights, shares = planner._weights(clouds, None)
    obstacles, expected = ObstaclePoints.of(clouds), []
    for k, (part, T) in enumerate(zip(parts, poses, strict=True)):
        target = planner._target(k, part, T, weights[k], float(shares[k]), None, Counter())
        expected += [
            (-g.quality, k, n, g.T_world_tcp.tobytes()) for n, g in enumerate(of_target(planner, target, obstacles))
        ]
    assert [(-g.quality, g.target, g.T_world_tcp.tobytes()) for g in found] == [
        (quality, k, T) for quality, k, _, T in sorted(expected)
    ]
    assert len({g.target for g in found}) > 2


def test_the_first_grasp_needs_few_tests() -> None:
    planner, (parts, poses) = GraspPlanner("jaw", BinConfig()), heap(0)
    first, every = Counter(), Counter()
    next(planner.search(parts, poses, rejected=first))
    list(planner.search(parts, poses, rejected=every))
    assert first[Rejection.TILT] == every[Rejection.TILT]
    assert first[Rejection.PARTS] < every[Rejection.PARTS] / 2


def test_a_planner_that_has_seen_other_bins_plans_as_a_new_one() -> None:
    used = GraspPlanner("jaw", BinConfig())
    for seed in (1, 2):
        used.plan(*heap(seed))
    again, new = used.plan(*heap(0)), GraspPlanner("jaw", BinConfig()).plan(*heap(0))
    assert [(g.target, g.quality, g.opening_m, g.T_world_tcp.tobytes()) for g in again] == [
        (g.target, g.quality, g.opening_m, g.T_world_tcp.tobytes()) for g in new
    ]
