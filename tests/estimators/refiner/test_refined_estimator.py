"""`RefinedEstimator` refines what any base estimator offers."""

from __future__ import annotations

import dataclasses

import numpy as np

from simpick.assets.library import get_part
from simpick.estimators import PoseEstimator
from simpick.estimators.refiner import RefinedEstimator
from simpick.estimators.refiner.flipped_starts import with_flips
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


def test_a_detection_without_a_mask_keeps_the_guess_and_its_score():
    frame, detection = frame_of("l_bracket")
    estimator = RefinedEstimator(TwoGuesses(), mode="guesses_refined")
    estimator.onboard(get_part("l_bracket"))
    (estimate,) = estimator.estimate(frame, [dataclasses.replace(detection, mask=None)])
    estimator.close()
    assert np.array_equal(estimate.T_camera_part, start(120, 0.0).T_camera_part)
    assert estimate.score == 0.9
    assert estimate.mode == "guesses_refined"


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
