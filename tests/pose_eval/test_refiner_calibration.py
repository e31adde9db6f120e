"""Outcomes of calibration: pooled, scored and drawn."""

from __future__ import annotations

import numpy as np
import pytest

from simpick.estimators.refiner.confidence import Confidence
from simpick.pose_eval.refiner_calibration import Outcomes, brier_score, plot_reliability, pooled

BY_SHADING = Confidence(0.0, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0))


def outcomes(shading: list[float], good: list[float], detections: list[int] | None = None) -> Outcomes:
    features = np.array([[0.5, 0.5, 0.5, value, 1.0, 0.5] for value in shading])
    return Outcomes(np.array(detections or range(len(good))), features, np.array(good))


def test_pooled_outcomes_keep_detections_cues_and_verdicts_together():
    both = pooled([outcomes([0.9, 0.2], [1.0, 0.0], [0, 0]), outcomes([0.5], [1.0])])
    assert both.detection.tolist() == [0, 0, 1]
    assert both.features[:, 3] == pytest.approx([0.9, 0.2, 0.5])
    assert both.good.tolist() == [1.0, 0.0, 1.0]


def test_the_most_probable_pose_answers_a_detection():
    answers = outcomes([0.2, 0.9, 0.5], [0.0, 1.0, 0.0], [0, 0, 1]).best(BY_SHADING)
    assert answers.detection.tolist() == [0, 1]
    assert answers.good.tolist() == [1.0, 0.0]


def test_brier_score_is_nothing_where_all_is_foreseen_and_a_quarter_for_a_coin():
    good = np.array([1.0, 0.0, 1.0])
    assert brier_score(good, good) == 0.0
    assert brier_score(np.full(3, 0.5), good) == 0.25


def test_reliability_is_drawn_for_each_set(tmp_path):
    rng = np.random.default_rng(0)
    some = outcomes(list(rng.uniform(0.1, 1.0, 30)), list((rng.random(30) < 0.5).astype(float)))
    widths = []
    for checked in ({"one start": some}, {"five starts": some, "one start": some}):
        file = tmp_path / f"{len(checked)}.png"
        plot_reliability(checked, BY_SHADING, file)
        # The width stands in bytes 16 to 20 of a PNG.
        widths.append(int.from_bytes(file.read_bytes()[16:20], "big"))
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.01)
