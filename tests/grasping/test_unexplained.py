"""What the image shows and no trusted pose explains is an obstacle as high as it may be."""

from collections import Counter

import numpy as np
import pytest

from simpick.assets.library import get_part
from simpick.geometry import Pinhole, invert, look_at
from simpick.geometry.transforms import so3_exp, transform, transform_points
from simpick.grasping import GraspPlanner, Rejection, UnexplainedSpace
from simpick.grasping.part_grasps import symmetric_grasps
from simpick.grasping.part_surface import point_spacing_m, surface_points
from simpick.grasping.unexplained import columns_over_floor, outline
from simpick.scene.config import BinConfig

NUT = get_part("hex_nut")
CAMERA = Pinhole(320, 240, 480.0, 480.0, 160.0, 120.0)
T_WORLD_CAMERA = look_at(np.array([0.5, 0.0, 0.9]), np.array([0.5, 0.0, 0.0]))
RIM_M = 0.12


def lying(x_m: float = 0.5, y_m: float = 0.0) -> np.ndarray:
    """Return a hex nut (16 mm high) flat on the bin's floor."""
    return transform(so3_exp(np.array([0, 0, 0.3])), np.array([x_m, y_m, 0.008]))


def seen(*poses: np.ndarray) -> np.ndarray:
    """Return the foreground of nuts at these poses."""
    points = [transform_points(invert(T_WORLD_CAMERA) @ T, surface_points(NUT)) for T in poses]
    return np.any([outline(own, point_spacing_m(NUT), CAMERA) for own in points], axis=0)


def space(foreground: np.ndarray, *poses: np.ndarray, scores: list[float] | None = None) -> UnexplainedSpace:
    parts, scores = [NUT] * len(poses), [0.9] * len(poses) if scores is None else scores
    return UnexplainedSpace.of(foreground, CAMERA, T_WORLD_CAMERA, parts, list(poses), scores, RIM_M)


@pytest.fixture(scope="module")
def planner() -> GraspPlanner:
    return GraspPlanner("jaw", BinConfig())


def test_an_explained_bin_leaves_nothing() -> None:
    poses = lying(), lying(y_m=0.1)
    assert not space(seen(*poses), *poses).pixels.any()


def test_a_part_that_no_estimate_explains_is_left_as_high_as_the_highest_estimate() -> None:
    left = space(seen(lying(), lying(y_m=0.1)), lying())
    points = left.around(0)
    assert 0.0 <= points[:, 2].min() < 1e-6 and 0.008 < points[:, 2].max() <= 0.016 + 1e-6
    np.testing.assert_allclose(points[points[:, 2] < 1e-6, :2].mean(axis=0), [0.5, 0.1], atol=0.004)


def test_without_a_trusted_estimate_it_may_be_as_high_as_the_bin() -> None:
    left = space(seen(lying()), lying(y_m=0.1), scores=[0.01])
    assert left.height_m == RIM_M
    assert left.around(0)[:, 2].max() == pytest.approx(RIM_M, abs=0.006)


def test_an_estimate_that_is_not_trusted_explains_nothing_but_is_not_in_its_own_way() -> None:
    left = space(seen(lying(), lying(y_m=0.1)), lying(), lying(y_m=0.1), scores=[0.9, 0.01])
    assert left.pixels.any() and len(left.around(0)) > 50
    assert len(left.around(1)) == 0


def test_columns_follow_the_lines_of_sight() -> None:
    pixels = np.zeros((240, 320), bool)
    pixels[40:60, 250:270] = True
    points = columns_over_floor(pixels, CAMERA, T_WORLD_CAMERA, 0.03)
    u, v = CAMERA.project(transform_points(invert(T_WORLD_CAMERA), points)).T
    assert len(points) and pixels[v.astype(int), u.astype(int)].all()


def test_nothing_is_seen_of_a_part_behind_the_camera_or_beside_the_image() -> None:
    behind, beside = transform(translation=np.array([0.5, 0.0, 2.0])), lying(y_m=3.0)
    for T in (behind, beside):
        assert not space(np.ones((240, 320), bool), T).outlines[0].any()


def test_a_grasp_beside_something_unexplained_comes_after_one_that_is_free(planner: GraspPlanner) -> None:
    """The nut to the left is worth more, but what touches it on both sides has no pose."""
    left, right = lying(y_m=-0.08), lying(y_m=0.08)
    around_left = [lying(x_m=0.5 + dx, y_m=-0.08 + dy) for dx, dy in ((0.036, 0), (-0.036, 0), (0, 0.036), (0, -0.036))]
    scores = [0.9, 0.6]
    foreground = seen(left, right, *around_left)
    blind = next(planner.search([NUT, NUT], [left, right], scores=scores))
    assert blind.target == 0
    unexplained = space(foreground, left, right, scores=scores)
    first, *others = planner.search([NUT, NUT], [left, right], scores=scores, unexplained=unexplained)
    assert first.target == 1
    # It is the last choice, not ruled out: nobody knows how high it is.
    assert {grasp.target for grasp in others} == {0, 1}


def test_an_improbable_estimate_is_not_grasped_and_rules_no_grasp_out(planner: GraspPlanner) -> None:
    """It lies between the pads of every grasp of the nut that the image shows, and is probably wrong."""
    poses = [lying(), lying(x_m=0.502, y_m=0.002)]
    foreground, probable, improbable = seen(lying()), [0.9, 0.8], [0.9, 0.05]
    unexplained = space(foreground, *poses, scores=probable)
    assert not list(planner.search([NUT, NUT], poses, scores=probable, unexplained=unexplained))
    rejected: Counter[Rejection] = Counter()
    unexplained = space(foreground, *poses, scores=improbable)
    found = list(planner.search([NUT, NUT], poses, scores=improbable, unexplained=unexplained, rejected=rejected))
    assert {grasp.target for grasp in found} == {0}
    assert rejected[Rejection.DOUBTFUL] == len(symmetric_grasps(NUT, "jaw"))
    # What may still lie there makes them the last choice.
    alone = next(planner.search([NUT], [lying()], scores=[0.9]))
    assert found[0].quality < 0.1 * alone.quality


def test_pixels_of_nothing_change_nothing(planner: GraspPlanner) -> None:
    empty = space(np.zeros((240, 320), bool), lying())
    with_space = list(planner.search([NUT], [lying()], unexplained=empty))
    assert [g.quality for g in with_space] == [g.quality for g in planner.plan([NUT], [lying()])]


@pytest.mark.parametrize(
    ("score", "is_trusted", "explains"), [(0.3, True, True), (0.29, True, False), (0.09, False, False)]
)
def test_an_estimate_is_trusted_from_0_1_on_and_explains_from_0_3_on(
    score: float, is_trusted: bool, explains: bool
) -> None:
    poses = [lying(), lying(y_m=0.1)]
    left = space(seen(*poses), *poses, scores=[0.9, score])
    assert left.trusted == (frozenset({0, 1}) if is_trusted else frozenset({0}))
    assert left.pixels.any() != explains


def test_where_all_estimates_are_improbable_they_are_trusted_but_explain_nothing() -> None:
    poses = [lying(), lying(y_m=0.1)]
    left = space(seen(*poses), *poses, scores=[0.05, 0.01])
    assert left.trusted == frozenset({0, 1})
    assert left.pixels.any()


@pytest.mark.parametrize(("width_px", "is_left"), [(4, False), (5, True)])
def test_what_is_narrower_than_5_px_is_a_rim(width_px: int, is_left: bool) -> None:
    stripe = np.zeros((240, 320), bool)
    stripe[100 : 100 + width_px, 50:270] = True
    assert space(stripe).pixels.any() == is_left


def at_pixels(*places: tuple[float, float]) -> np.ndarray:
    """Return points in the camera's frame, 1 m away, at these pixels (column, row)."""
    return np.array([[(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0] for u, v in places])


def test_a_point_covers_itself_and_3_px_around_it_also_at_the_edges() -> None:
    covered = outline(at_pixels((100.5, 80.5)), 0.02, CAMERA)
    assert covered[77:84, 97:104].all() and covered.sum() == 49
    for u, v in ((0.5, 0.5), (319.5, 0.5), (0.5, 239.5), (319.5, 239.5)):
        assert outline(at_pixels((u, v)), 0.02, CAMERA).sum() == 16
    assert not outline(at_pixels((320.5, 80.5), (100.5, 240.5), (-0.5, 80.5), (100.5, -0.5)), 0.02, CAMERA).any()


def test_points_are_joined_up_to_twice_their_spacing() -> None:
    # A spacing of 20 mm is 9.6 px at 1 m.
    joined, apart = (outline(at_pixels((100.5, 80.5), (u, 80.5)), 0.02, CAMERA)[80, 100:121] for u in (120.5, 122.5))
    assert joined.all() and not apart[4:19].any()
    # Nothing is joined with the image's edge.
    assert not outline(at_pixels((8.5, 80.5)), 0.02, CAMERA)[80, :5].any()


def test_columns_stand_on_every_fourth_pixel_and_rise_in_equal_steps_also_where_the_camera_leans() -> None:
    T = look_at(np.array([0.5, -0.6, 0.7]), np.array([0.5, 0.0, 0.0]))
    points = columns_over_floor(np.ones((240, 320), bool), CAMERA, T, 0.03)
    np.testing.assert_allclose(np.unique(points[:, 2].round(9)), np.arange(6) * 0.006, atol=1e-9)
    centres = (CAMERA.project(transform_points(invert(T), points)) - 2.5) / 4
    np.testing.assert_allclose(centres, centres.round(), atol=1e-6)
    assert len(points) == 6 * 80 * 60


def test_level_lines_of_sight_meet_nothing() -> None:
    level = look_at(np.array([0.5, -0.6, 0.2]), np.array([0.5, 0.0, 0.2]))
    points = columns_over_floor(np.ones((240, 320), bool), CAMERA, level, 0.03)
    assert len(points) and np.linalg.norm(points - level[:3, 3], axis=1).max() < 0.2 / 0.1 * 1.1


def test_the_nearer_points_are_the_wider_are_their_gaps() -> None:
    # A spacing of 20 mm is 19.2 px at half a metre.
    assert outline(at_pixels((100.5, 80.5), (130.5, 80.5)) / 2, 0.02, CAMERA)[80, 100:131].all()


def test_each_pose_has_a_part() -> None:
    with pytest.raises(ValueError, match="longer"):
        UnexplainedSpace.of(np.zeros((240, 320), bool), CAMERA, T_WORLD_CAMERA, [NUT], [lying()] * 2, [0.9] * 2, RIM_M)
