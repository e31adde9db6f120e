"""`RefinedEstimator` refines what any base estimator offers."""

from __future__ import annotations

import dataclasses
from contextlib import closing

import numpy as np

from simpick.assets.library import get_part
from simpick.estimators import PoseEstimator
from simpick.estimators.refiner import RefinedEstimator
from simpick.estimators.refiner.box_masks import BoxMasks
from simpick.estimators.refiner.flipped_starts import with_flips
from simpick.geometry import rotation_angle
from simpick.records import PoseEstimate, PoseHypothesis
from tests.estimators.refiner.scenes import T_TRUE, frame_of, start


class TwoGuesses:
    """Answers the first detection only, with one hypothesis far off and one near."""

    def onboard(self, part):
        pass

    def estimate(self, frame, detections):
        guesses = (start(120, 0.0), start(8, 0.03))
        return [
            PoseEstimate(d.part, guesses[0].T_camera_part, 0.9, "guesses", 0.0, guesses, detection=d)
            for d in detections[:1]
        ]


def test_the_best_refined_hypothesis_answers():
    frame, detection = frame_of("l_bracket")
    estimator = RefinedEstimator(TwoGuesses(), mode="guesses_refined")
    assert isinstance(estimator, PoseEstimator)
    estimator.onboard(get_part("l_bracket"))
    estimates = estimator.estimate(frame, [detection, detection])
    assert estimator.estimate(frame, []) == []
    estimator.close()
    assert len(estimates) == 1
    (estimate,) = estimates
    assert estimate.mode == "guesses_refined"
    assert estimate.detection is detection
    assert estimate.hypotheses[0].T_camera_part is estimate.T_camera_part
    assert np.linalg.norm(estimate.T_camera_part[:3, 3] - T_TRUE[:3, 3]) < 4e-3
    assert 0 < estimate.score < 1
    assert estimate.score == estimate.hypotheses[0].score
    assert estimate.elapsed_s > 0


class NearGuess(TwoGuesses):
    """Answers each detection with a pose 8 degrees and 3 % of the depth off."""

    def estimate(self, frame, detections):
        T = start(8, 0.03).T_camera_part
        return [PoseEstimate(d.part, T, 0.9, "guess", 0.0, detection=d) for d in detections]


def test_a_box_is_refined_by_a_mask_that_its_own_pose_shows():
    frame, detection = frame_of("l_bracket")
    box = dataclasses.replace(detection, mask=None)
    with closing(RefinedEstimator(NearGuess(), mode="guess_refined")) as estimator:
        estimator.onboard(get_part("l_bracket"))
        (estimate,) = estimator.estimate(frame, [box])
    assert estimate.detection is box and estimate.mode == "guess_refined" and estimate.score != 0.9
    error = rotation_angle(estimate.T_camera_part[:3, :3].T @ T_TRUE[:3, :3])
    assert np.degrees(error) < 4.0
    assert np.linalg.norm(estimate.T_camera_part[:3, 3] - T_TRUE[:3, 3]) < 10e-3  # Of 18 mm.


def test_a_box_that_an_instance_fills_gets_its_mask_whatever_the_pose():
    frame, detection = frame_of("l_bracket")
    box = dataclasses.replace(detection, mask=None)
    away = T_TRUE.copy()
    away[0, 3] += 0.05
    with BoxMasks() as masks:
        estimate = PoseEstimate("l_bracket", away, 0.9, "guess", 0.0, detection=box)
        (found,) = masks.masked(frame, [estimate], {"l_bracket": get_part("l_bracket")})
    assert found.mask is not None and detection.mask is not None
    assert (found.mask & detection.mask).sum() > 0.93 * (found.mask | detection.mask).sum()


def test_a_part_in_front_hides_what_is_behind_it_in_the_masks_of_boxes():
    frame, detection = frame_of("l_bracket")
    # A box that nothing fills.
    width, height = detection.box_xyxy_px[2:] - detection.box_xyxy_px[:2]
    wide = detection.box_xyxy_px + 0.2 * np.array([-width, -height, width, height])
    box = dataclasses.replace(detection, mask=None, box_xyxy_px=wide)
    nearer = T_TRUE.copy()
    nearer[:3, 3] *= 0.8
    estimates = [PoseEstimate("l_bracket", T, 0.9, "guess", 0.0, detection=box) for T in (T_TRUE, nearer)]
    parts = {"l_bracket": get_part("l_bracket")}
    with BoxMasks() as masks:
        alone, hidden = masks.masked(frame, estimates[:1], parts)[0].mask, masks.masked(frame, estimates, parts)[0].mask
        kept = masks.masked(frame, [dataclasses.replace(estimates[0], detection=detection)], parts)
    assert alone is not None and hidden is not None and kept[0] is detection
    assert (alone & detection.mask).sum() > 0.93 * (alone | detection.mask).sum()
    assert hidden.sum() < 0.2 * alone.sum()


class FlippedGuess(TwoGuesses):
    """Answers with the true pose turned by half a turn about the box's axis."""

    def estimate(self, frame, detections):
        (flipped,) = (h for h in with_flips(PoseHypothesis(T_TRUE, 1.0), get_part("pillow_block"))[1:2])
        return [PoseEstimate(d.part, flipped.T_camera_part, 0.9, "guess", 0.0, detection=d) for d in detections]


def test_a_lone_guess_that_is_flipped_is_put_right():
    part = get_part("pillow_block")
    frame, detection = frame_of("pillow_block")
    estimator = RefinedEstimator(FlippedGuess())
    estimator.onboard(part)
    (estimate,) = estimator.estimate(frame, [detection])
    estimator.close()
    R = estimate.T_camera_part[:3, :3]
    assert np.degrees(part.symmetries.rotation_distance(R, T_TRUE[:3, :3])) < 2.0


def test_flips_keep_the_box_in_place_and_leave_out_symmetric_ones():
    lone = PoseHypothesis(T_TRUE, 0.7)
    bracket = get_part("l_bracket")
    starts = with_flips(lone, bracket)
    assert len(starts) == 4
    assert starts[0] is lone
    centre = np.append(bracket.mesh.vertices.min(axis=0) + bracket.mesh.vertices.max(axis=0), 2.0) / 2
    assert all(np.allclose(h.T_camera_part @ centre, T_TRUE @ centre) for h in starts)
    # A bushing is the same after any half turn.
    assert with_flips(lone, get_part("bushing")) == (lone,)
