"""What a part's grasps are worth, which of them are tried, and what is left of those that touch other parts."""

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry.transforms import so3_exp, transform
from simpick.grasping import GraspPlanner, PlannerConfig, Rejection
from simpick.grasping.planner import WorldGrasp
from simpick.records import Grasp
from simpick.scene.config import BinConfig

NUT = get_part("hex_nut")
HIGH = transform(translation=np.array([0.5, 0.0, 0.2]))
WIDE_M, NARROW_M = PlannerConfig().side_clearances_m
TOUCHING = PlannerConfig().touching_factor
MOST = PlannerConfig().most_points_touched
DOWN = so3_exp(np.array([np.pi, 0.0, 0.0]))


def grasps(qualities: Sequence[float]) -> list[Grasp]:
    """Return grasps from straight above, each 0.01 mm wider than the one before, which tells them apart."""
    return [Grasp(transform(DOWN), 0.010 + 1e-5 * k, q) for k, q in enumerate(qualities)]


def numbers(found: Sequence[WorldGrasp]) -> list[int]:
    """Return which of `grasps` these are."""
    return [round((g.grasp.width_m - 0.010) / 1e-5) for g in found]


@pytest.fixture
def make(monkeypatch: pytest.MonkeyPatch) -> Callable[..., GraspPlanner]:
    """Return a function that makes a planner of given grasps, in whose way `touched` of an opening's points are."""

    def planner(
        offered: list[Grasp], touched: Callable[[float], int] = lambda opening_m: 0, kind: str = "jaw", **settings: Any
    ) -> GraspPlanner:
        monkeypatch.setattr("simpick.grasping.planner.symmetric_grasps", lambda part, gripper: offered)
        own = GraspPlanner(kind, BinConfig(), PlannerConfig(**settings))
        monkeypatch.setattr(own, "_touched", lambda T, shape, obstacles, target: touched(shape.opening_m))
        return own

    return planner


def number_of(opening_m: float) -> int:
    """Return which of `grasps` this opening, the wider or the narrower one, belongs to."""
    return round((opening_m - 0.010 - 2 * (WIDE_M if opening_m > 0.019 else NARROW_M)) / 1e-5)


def sheet(z_m: float, share: float = 1.0) -> np.ndarray:
    """Return 400 points of a level square of 40 mm, of which only a share of the length is there."""
    x, y = np.meshgrid(np.arange(0.0, 0.04, 0.002) * share, np.arange(0.0, 0.04, 0.002))
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z_m)], axis=1)


def test_a_part_is_worth_more_the_higher_and_the_more_exposed_it_is() -> None:
    clouds = [sheet(0.02), sheet(0.06, 0.5), sheet(0.10) + np.array([0.1, 0.0, 0.0])]
    weights, exposure = GraspPlanner("jaw", BinConfig())._weights(clouds, None)
    assert exposure[0] == pytest.approx(0.5, abs=0.06) and list(exposure[1:]) == [1, 1]
    covered = 0.1 + 0.9 * exposure[0] ** 2
    expected = [covered * (0.6 + 0.4 * np.exp(-1)), 0.6 + 0.4 * np.exp(-0.5), 1.0]
    assert weights == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("score", "worth"), [(0.5, 0.5), (2.0, 1.0), (-1.0, 0.0)])
def test_a_part_is_worth_its_score_within_0_and_1(score: float, worth: float) -> None:
    assert GraspPlanner("jaw", BinConfig())._weights([sheet(0.02)], [score])[0] == [worth]


def test_the_best_are_tried_and_of_equals_the_first(make: Callable[..., GraspPlanner]) -> None:
    qualities = [0.8 if k % 3 else 0.5 for k in range(400)]
    planner = make(grasps(qualities), tries_per_target=300, grasps_per_target=300)
    best = [k for k in range(400) if k % 3] + [k for k in range(400) if k % 3 == 0]
    assert numbers(planner.plan([NUT], [HIGH])) == best[:300]


def test_grasps_are_made_when_they_may_be_the_next(
    make: Callable[..., GraspPlanner], monkeypatch: pytest.MonkeyPatch
) -> None:
    planner, made = make(grasps([0.9, 0.8, 0.4])), []
    tried = planner._tried
    monkeypatch.setattr(planner, "_tried", lambda *a: made.append((a[0].index, a[1])) or tried(*a))
    places = [transform(translation=np.array([0.5, y_m, 0.2])) for y_m in (-0.1, 0.1)]
    search = planner.search([NUT, NUT], places, scores=[0.9, 0.5])
    expected = [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (1, 2)]
    for count, (target, rank) in enumerate(expected, 1):
        found = next(search)
        assert (found.target, numbers([found])) == (target, [rank]) and made == expected[:count]


def test_a_part_without_grasps_is_not_counted(make: Callable[..., GraspPlanner]) -> None:
    rejected: Counter[Rejection] = Counter()
    assert not list(make([]).search([NUT], [HIGH], rejected=rejected)) and rejected.total() == 0


def test_two_planners_see_the_same_surface() -> None:
    first, second = GraspPlanner("jaw", BinConfig()), GraspPlanner("jaw", BinConfig())
    first.prepare(NUT)
    second.prepare(NUT)
    np.testing.assert_array_equal(first._points[NUT.content_hash], second._points[NUT.content_hash])


@pytest.mark.parametrize("touched", [1, 5, MOST])
def test_a_grasp_that_touches_others_is_worth_little(make: Callable[..., GraspPlanner], touched: int) -> None:
    found = make(grasps([0.9]), lambda opening_m: touched).plan([NUT], [HIGH])
    worth = 0.9 * TOUCHING / (1 + touched)
    assert [g.quality for g in found] == pytest.approx([worth, 0.8 * worth])
    assert [g.opening_m for g in found] == pytest.approx([0.010 + 2 * WIDE_M, 0.010 + 2 * NARROW_M])


def test_grasps_that_touch_too_much_or_nothing_are_counted_as_such(make: Callable[..., GraspPlanner]) -> None:
    for touched, expected in ((MOST + 1, 5), (MOST, 0), (0, 0)):
        rejected: Counter[Rejection] = Counter()
        planner = make(grasps([0.9] * 5), lambda opening_m, touched=touched: touched)
        assert bool(list(planner.search([NUT], [HIGH], rejected=rejected))) == (expected == 0)
        assert rejected.total() == rejected[Rejection.PARTS] == expected


@pytest.mark.parametrize("touched_wide", [1, MOST + 1])
def test_a_narrower_opening_may_be_free(make: Callable[..., GraspPlanner], touched_wide: int) -> None:
    found = make(grasps([0.9]), lambda opening_m: touched_wide if opening_m > 0.019 else 0).plan([NUT], [HIGH])
    assert [g.quality for g in found] == pytest.approx([0.8 * 0.9])
    assert [g.opening_m for g in found] == pytest.approx([0.010 + 2 * NARROW_M])


def test_what_touches_is_left_out_where_anything_is_free(make: Callable[..., GraspPlanner]) -> None:
    planner = make(grasps([0.9] * 6), lambda opening_m: number_of(opening_m) % 2)
    assert numbers(planner.plan([NUT], [HIGH])) == [0, 2, 4]


def test_of_those_that_touch_the_best_are_left(make: Callable[..., GraspPlanner]) -> None:
    planner = make(grasps([0.9] * 6), lambda opening_m: 10 - number_of(opening_m), grasps_per_target=3)
    found = planner.plan([NUT], [HIGH])
    # Each has two openings; the narrower one of the last (5 points, by 0.8) comes after the wider one of the fourth.
    expected = sorted((-c * 0.9 * TOUCHING / (11 - k), k) for k in range(6) for c in (1.0, 0.8))[:3]
    assert numbers(found) == [k for _, k in expected]
    assert [g.quality for g in found] == pytest.approx([-q for q, _ in expected])


def test_suction_has_one_opening(make: Callable[..., GraspPlanner]) -> None:
    down = [Grasp(transform(DOWN), 0.0, 0.9)]
    for touched, worth in ((0, 0.9), (3, 0.9 * TOUCHING / 4)):
        found = make(down, lambda opening_m, touched=touched: touched, "suction").plan([NUT], [HIGH])
        assert [(g.quality, g.opening_m) for g in found] == [(pytest.approx(worth), 0.0)]
