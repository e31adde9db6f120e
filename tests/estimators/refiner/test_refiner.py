"""The refiner finds known poses, chooses among hypotheses, and says what it cannot work with."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from jaxtyping import Float

from simpick.assets.library import get_part
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.refiner import AlignmentLevel, Refiner, RefinerConfig
from simpick.geometry import box_of_mask, transform
from simpick.records import PoseHypothesis
from tests.estimators.refiner.scenes import T_TRUE, frame_of, hidden_by, start


@pytest.fixture(scope="module")
def refiner():
    with Refiner() as refiner:
        for part in ("pipe_tee", "l_bracket", "bushing"):
            refiner.onboard(get_part(part))
        yield refiner


def errors(part: str, T: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
    """Return rotation in degrees over symmetries, and translation in mm."""
    turned = get_part(part).symmetries.rotation_distance(T[:3, :3], T_TRUE[:3, :3])
    return float(np.degrees(turned)), float(1e3 * np.linalg.norm(T[:3, 3] - T_TRUE[:3, 3]))


@pytest.mark.parametrize("depth_share", [-0.1, 0.1])
@pytest.mark.parametrize("part", ["pipe_tee", "l_bracket", "bushing"])
def test_converges_from_20_degrees_and_a_tenth_of_the_depth(refiner, part, depth_share):
    frame, detection = frame_of(part)
    (best_first,) = refiner.refine(frame, [detection], [[start(20, depth_share)]])
    deg, mm = errors(part, best_first[0].T_camera_part)
    assert deg < 2.0
    assert mm < 4.0


def test_a_part_half_hidden_by_another_detection_is_found(refiner):
    frame, detection = frame_of("pipe_tee")
    x1, _, x2, _ = detection.box_xyxy_px
    occluder = np.zeros(frame.rgb.shape[:2], bool)
    occluder[:, int(x1 + 0.65 * (x2 - x1)) : int(x2) + 10] = True
    seen, other = hidden_by(detection, occluder)
    frame.rgb[occluder] = 200
    (best_first, untouched) = refiner.refine(frame, [seen, other], [[start(10, 0.03)], []])
    deg, mm = errors("pipe_tee", best_first[0].T_camera_part)
    assert deg < 4.0
    assert mm < 8.0
    assert untouched == ()


def test_the_hypothesis_that_fits_comes_first_with_a_score_in_the_unit_interval(refiner):
    frame, detection = frame_of("l_bracket")
    (best_first,) = refiner.refine(frame, [detection], [[start(150, 0.0), start(8, 0.02)]])
    assert errors("l_bracket", best_first[0].T_camera_part)[0] < 2.0
    scores = [h.score for h in best_first]
    assert scores == sorted(scores, reverse=True)
    assert all(0 < score <= 1 for score in scores)


def test_equal_hypotheses_become_one(refiner):
    frame, detection = frame_of("bushing")
    # A bushing turned about its axis is the same pose.
    turned = get_part("bushing").symmetries.transforms(7)[3]
    again = PoseHypothesis(start(3, 0.0).T_camera_part @ turned, 0.5)
    (best_first,) = refiner.refine(frame, [detection], [[start(3, 0.0), again]])
    assert len(best_first) == 1


def test_results_repeat(refiner):
    frame, detection = frame_of("l_bracket")
    first, second = (refiner.refine(frame, [detection], [[start(15, 0.05)]])[0][0] for _ in range(2))
    assert np.array_equal(first.T_camera_part, second.T_camera_part)
    assert first.score == second.score


def test_what_cannot_be_compared_comes_back_as_it_came(refiner):
    frame, detection = frame_of("pipe_tee")
    assert detection.mask is not None
    empty = np.zeros_like(detection.mask)
    one_pixel = empty.copy()
    one_pixel[50, 60] = True
    outside = dataclasses.replace(detection, mask=None, box_xyxy_px=np.array([900.0, 900.0, 950.0, 950.0]))
    nowhere = dataclasses.replace(detection, mask=None, box_xyxy_px=np.full(4, np.nan))
    detections = [dataclasses.replace(detection, mask=m) for m in (empty, one_pixel)] + [outside, nowhere]
    given = (start(5, 0.0),)
    assert refiner.refine(frame, detections, [given] * 4) == [given] * 4
    assert refiner.refine(frame, [detection], [[]]) == [()]
    assert refiner.refine(frame, [], []) == []


def test_poses_that_are_none_are_left_out_where_there_are_others(refiner):
    frame, detection = frame_of("l_bracket")
    broken = PoseHypothesis(np.full((4, 4), np.nan), 0.9)
    behind = PoseHypothesis(transform(translation=np.array([0.0, 0.0, -0.5])), 0.9)
    (best_first,) = refiner.refine(frame, [detection], [[broken, behind, start(5, 0.0)]])
    assert all(np.isfinite(h.T_camera_part).all() and h.T_camera_part[2, 3] > 0 for h in best_first)
    assert errors("l_bracket", best_first[0].T_camera_part)[0] < 2.0
    (as_they_came,) = refiner.refine(frame, [detection], [[broken]])
    assert as_they_came == (broken,)


def test_a_box_is_not_fitted(refiner):
    frame, detection = frame_of("l_bracket")
    given = (start(5, 0.0),)
    assert refiner.refine(frame, [dataclasses.replace(detection, mask=None)], [given]) == [given]


def test_a_box_hides_no_other_part(refiner):
    frame, detection = frame_of("l_bracket")
    around = dataclasses.replace(detection, mask=None)
    alone = refiner.refine(frame, [detection], [[start(15, 0.05)]])
    assert np.array_equal(
        refiner.refine(frame, [detection, around], [[start(15, 0.05)], []])[0][0].T_camera_part,
        alone[0][0].T_camera_part,
    )


@pytest.mark.parametrize("kept", ["left", "right", "top"])
def test_a_mask_of_half_the_part_does_not_spoil_a_good_pose(refiner, kept):
    frame, detection = frame_of("pipe_tee")
    assert detection.mask is not None
    x, y = (detection.box_xyxy_px[:2] + detection.box_xyxy_px[2:]).astype(int) // 2
    half = detection.mask.copy()
    half[{"left": np.s_[:, x:], "right": np.s_[:, :x], "top": np.s_[y:]}[kept]] = False
    wrong = dataclasses.replace(detection, mask=half, box_xyxy_px=box_of_mask(half))
    (best_first,) = refiner.refine(frame, [wrong], [[start(2, 0.005)]])
    deg, mm = errors("pipe_tee", best_first[0].T_camera_part)
    assert deg < 4.0
    assert mm < 8.0


def test_a_mask_with_a_neighbour_in_it_does_not_spoil_a_good_pose(refiner):
    frame, detection = frame_of("l_bracket")
    assert detection.mask is not None
    merged = detection.mask.copy()
    _, y1, x2, y2 = detection.box_xyxy_px.astype(int)
    frame.rgb[y1:y2, x2 - 2 : x2 + 25][~detection.mask[y1:y2, x2 - 2 : x2 + 25]] = 170
    merged[y1:y2, x2 - 2 : x2 + 25] = True
    wrong = dataclasses.replace(detection, mask=merged, box_xyxy_px=box_of_mask(merged))
    (best_first,) = refiner.refine(frame, [wrong], [[start(2, 0.005)]])
    deg, mm = errors("l_bracket", best_first[0].T_camera_part)
    assert deg < 4.0
    assert mm < 8.0


def test_a_part_that_was_not_onboarded_is_named(refiner):
    frame, detection = frame_of("pipe_tee")
    with pytest.raises(UnknownNameError, match=r"(?s)'hex_nut'.*onboard\(part\)"):
        refiner.refine(frame, [dataclasses.replace(detection, part="hex_nut")], [[start(5, 0.0)]])


def test_lists_must_match_and_masks_must_fit(refiner):
    frame, detection = frame_of("pipe_tee")
    with pytest.raises(ConfigError, match="one list of hypotheses for each detection, got 0 for 1"):
        refiner.refine(frame, [detection], [])
    small = dataclasses.replace(detection, mask=np.ones((4, 5), bool))
    with pytest.raises(ConfigError, match="size 320 x 240 px, got 5 x 4"):
        refiner.refine(frame, [small], [[start(5, 0.0)]])


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"levels": ()}, "levels must be of length at least 1"),
        ({"padding": 0.5}, "padding must be between 1 and 4, got 0.5"),
        ({"silhouette_scale": 0.0}, "silhouette_scale must be above 0"),
        ({"occluder_weight": 2.0}, "occluder_weight must be between 0 and 1, got 2.0"),
        ({"renderers": 0}, "renderers must be at least 1, got 0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        RefinerConfig(**settings)


def test_levels_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="size_px must be between 16 and 512, got 8"):
        AlignmentLevel(8, 1.0, 1, 1)
    with pytest.raises(ConfigError, match="stride must divide size_px = 48, got 5"):
        AlignmentLevel(48, 1.0, 1, 1, stride=5)
