"""Which views serve as templates."""

import numpy as np
import pytest

from simpick.estimators.raypose.crops.template_choice import (
    align_turns,
    choose_around,
    draw_around,
    draw_over_sphere,
    spread_directions,
    spread_over_sphere,
    view_angles,
)
from simpick.geometry import random_rotation, rotation_angle, so3_exp
from simpick.rendering.view_sphere import look_at_part, view_directions

RS = look_at_part(view_directions(162), 1.0)[:, :3, :3]


def turned(views: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the rotations of views after turning their pictures clockwise, that is about +z."""
    return so3_exp(angles[:, None] * np.array([0.0, 0.0, 1.0])) @ RS[views]


def gaps(directions: np.ndarray) -> np.ndarray:
    """Return for each direction the angle to its nearest neighbour, in degrees."""
    cosine = directions @ directions.T
    np.fill_diagonal(cosine, -1)
    return np.degrees(np.arccos(cosine.max(axis=1).clip(-1, 1)))


def test_turns_bring_views_as_close_as_turning_can() -> None:
    target = random_rotation(np.random.default_rng(0))
    every = np.arange(len(RS))
    best = rotation_angle(turned(every, align_turns(RS, target)) @ target.T)
    for angle in np.linspace(-np.pi, np.pi, 60):
        assert (rotation_angle(turned(every, np.full(len(RS), angle)) @ target.T) >= best - 1e-9).all()


def test_a_view_is_aligned_with_its_own_turn() -> None:
    target = so3_exp(np.array([0.0, 0.0, 0.7])) @ RS[5]
    assert align_turns(RS[5:6], target)[0] == pytest.approx(0.7)
    assert view_angles(RS[5:6], target)[0] == pytest.approx(0, abs=1e-6)
    tilted = so3_exp(np.array([0.3, 0.0, 0.0])) @ RS[5]
    assert view_angles(RS[5:6], tilted)[0] == pytest.approx(0.3)


def test_spread_directions_are_spread() -> None:
    for count in (1, 2, 8, 50):
        directions = spread_directions(count)
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    assert gaps(spread_directions(8)).min() > 45
    assert np.linalg.norm(spread_directions(50).mean(axis=0)) < 0.02


def test_fixed_coarse_templates_are_far_apart_and_always_the_same() -> None:
    views = spread_over_sphere(RS, 8)
    assert len(set(views.tolist())) == 8
    assert gaps(RS[views, 2]).min() > 45
    assert np.array_equal(spread_over_sphere(RS, 8), views)


def test_drawn_coarse_templates_cover_the_sphere_in_every_draw_and_differ() -> None:
    rng = np.random.default_rng(0)
    draws = [draw_over_sphere(RS, 8, rng) for _ in range(50)]
    for views in draws:
        # From any direction some template is within a right angle: the part is covered from all sides.
        assert np.degrees(np.arccos((RS[:, 2] @ RS[views, 2].T).max(axis=1).clip(-1, 1))).max() < 85
    assert len({tuple(views) for views in draws}) > 40
    assert len({int(v) for views in draws for v in views}) > 120
    again = [draw_over_sphere(RS, 8, np.random.default_rng(0)) for _ in range(2)]
    assert np.array_equal(again[0], again[1])
    fixed = [draw_over_sphere(RS, 8, rng, fixed=True) for _ in range(2)]
    assert np.array_equal(fixed[0], fixed[1]) and np.array_equal(fixed[0], spread_over_sphere(RS, 8))


@pytest.mark.parametrize("spread_deg", [30.0, 60.0])
def test_fine_templates_are_within_the_spread(spread_deg: float) -> None:
    rng, worst = np.random.default_rng(0), 0.0
    for target in random_rotation(rng, (40,)):
        views, angles = draw_around(RS, target, 8, np.radians(spread_deg), rng)
        assert len(set(views.tolist())) == 8
        worst = max(worst, np.degrees(rotation_angle(turned(views, angles) @ target.T)).max())
    assert 0.7 * spread_deg < worst <= spread_deg + 1e-6


def test_where_too_few_views_are_within_the_spread_the_nearest_are_taken() -> None:
    rng = np.random.default_rng(0)
    for target in random_rotation(rng, (10,)):
        views, _ = draw_around(RS, target, 8, np.radians(5.0), rng)
        assert set(views.tolist()) == set(np.argsort(view_angles(RS, target))[:8].tolist())


def test_chosen_views_are_the_nearest_with_the_nearest_turn() -> None:
    target = random_rotation(np.random.default_rng(3))
    views, turns = choose_around(RS, target, 4, 24)
    angles = view_angles(RS, target)
    assert set(views.tolist()) == set(np.argsort(angles)[:4].tolist())
    assert ((turns >= 0) & (turns < 24)).all()
    exact = align_turns(RS[views], target)
    off = (turns * 2 * np.pi / 24 - exact + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() <= np.pi / 24 + 1e-9
