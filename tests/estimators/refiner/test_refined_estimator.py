"""`RefinedEstimator` refines what any base estimator offers."""

from __future__ import annotations

from unittest.mock import Mock

import numpy as np

import simpick.estimators.refiner
from simpick.assets.library import get_part
from simpick.estimators import PoseEstimator
from simpick.estimators.refiner import RefinedEstimator, read_confidence
from simpick.estimators.refiner.confidence import Confidence
from simpick.evaluation.perceptions import make_estimator
from simpick.records import PoseEstimate
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


def test_with_confidence_the_score_is_a_probability():
    frame, detection = frame_of("l_bracket")
    even = RefinedEstimator(TwoGuesses(), confidence=Confidence(0.0, (0.0, 0.0, 0.0, 0.0)))
    even.onboard(get_part("l_bracket"))
    (estimate,) = even.estimate(frame, [detection])
    even.close()
    assert estimate.score == 0.5
    assert estimate.hypotheses[0].score != 0.5


def test_the_shipped_modes_say_probabilities(monkeypatch):
    monkeypatch.setattr("simpick.estimators.refiner.RefinedEstimator", Mock())
    make_estimator("retrieval_refined")
    make = simpick.estimators.refiner.RefinedEstimator
    assert make.call_args.kwargs == {"mode": "retrieval_refined", "confidence": read_confidence()}
