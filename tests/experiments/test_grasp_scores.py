"""Grasp scores against hand-computed values."""

import math
from dataclasses import replace

import pytest

from simpick.experiments.analysis.grasp_scores import score_grasps
from simpick.records import PickOutcome
from tests.experiments.test_result_store import make_pick, make_result


def test_scores_by_hand() -> None:
    # Two bins of two parts: one emptied with one miss on the way, one given up after a success and two slips.
    missed_first = make_result(0, make_pick(0, PickOutcome.MISSED, 0), make_pick(1, target=0), make_pick(2, target=1))
    slips = [make_pick(k, PickOutcome.SLIPPED, 1) for k in (1, 2)]
    given_up = make_result(1, make_pick(0, target=0), *slips, ended="consecutive_failures")
    scores = score_grasps([missed_first, given_up])
    assert scores.attempts == 6
    assert scores.grasp_success == pytest.approx(3 / 6)
    assert scores.clearance == pytest.approx(3 / 4)
    assert scores.cleared_episodes == pytest.approx(1 / 2)
    # Targets: instance 0 missed first, instance 1 delivered; then instance 0 delivered, instance 1 slipped.
    assert scores.first_try_success == pytest.approx(2 / 4)
    # Each attempt moves 5 s and waits 0.2 s; simulating takes no robot time.
    assert scores.perception_s == pytest.approx(0.2)
    assert scores.mpph == pytest.approx(3600 * 3 / (6 * 5.2))
    assert scores.outcomes == {"success": 3, "slipped": 2, "missed": 1}
    assert scores.rotation_deg == 1.0 and scores.translation_mm == 2.0


def test_abstaining_is_no_attempt_but_costs_time() -> None:
    scores = score_grasps([make_result(0, make_pick(0), make_pick(1, PickOutcome.NO_GRASP, None), ended="max_picks")])
    assert (scores.attempts, scores.abstentions, scores.grasp_success) == (1, 1, 1.0)
    assert scores.clearance == 0.5
    # One motion of 5 s, two looks of 0.2 s.
    assert scores.mpph == pytest.approx(3600 / 5.4)
    assert scores.outcomes == {"no_grasp": 1, "success": 1}


def test_faulted_episodes_say_nothing_about_grasping() -> None:
    picks = (make_pick(0, PickOutcome.MISSED, 1), make_pick(1), make_pick(2, PickOutcome.SIMULATION_FAULT, 0))
    fault, whole = make_result(0, *picks, ended="simulation_fault"), make_result(1)
    scores, alone = score_grasps([fault, whole]), score_grasps([whole])
    assert scores == replace(alone, episodes=2, outcomes={"missed": 1, "simulation_fault": 1, "success": 2})
    # One of the two parts of the bin without a fault was delivered.
    assert (scores.attempts, scores.grasp_success, scores.clearance) == (1, 1.0, 0.5)


def test_no_episodes_give_no_numbers() -> None:
    scores = score_grasps([])
    assert scores.attempts == 0 and math.isnan(scores.grasp_success) and math.isnan(scores.mpph)
