"""Paired figures and bootstrap intervals against computations by hand."""

import dataclasses

import numpy as np
import pytest

from simpick.experiments.analysis.grasp_scores import score_grasps
from simpick.experiments.analysis.paired import MEASURES, PairedStatistics, best_mode, compare_modes, paired_bins
from simpick.experiments.result_store import EpisodeResult
from simpick.metrics.intervals import Interval
from simpick.records import PickOutcome, PoseError
from tests.experiments.test_result_store import make_pick, make_result

MISSED = PickOutcome.MISSED


def bin_of(mode: str, episode: int, *outcomes: PickOutcome, ended: str = "cleared") -> EpisodeResult:
    picks = [make_pick(k, outcome, k) for k, outcome in enumerate(outcomes)]
    return dataclasses.replace(make_result(episode, *picks, ended=ended), mode=mode)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_figures_are_those_of_a_run() -> None:
    results = [bin_of("a", 0, PickOutcome.SUCCESS, MISSED), bin_of("a", 1, PickOutcome.SUCCESS, PickOutcome.COLLISION)]
    measures, scores = compare_modes(results, ["a"], rng()).measures["a"], score_grasps(results)
    assert measures["grasp_success"].value == pytest.approx(100 * scores.grasp_success) == pytest.approx(50)
    assert measures["mpph"].value == pytest.approx(scores.mpph) == pytest.approx(3600 * 2 / (4 * 5.2))
    assert measures["clearance"].value == pytest.approx(100 * scores.clearance)
    assert measures["first_try"].value == pytest.approx(100 * scores.first_try_success)
    assert measures["collisions"].value == pytest.approx(25) and measures["double_picks"].value == 0
    assert measures["rotation_deg"].value == 1.0 and measures["depth_mm"].value == pytest.approx(1.2)


def test_differences_are_within_bins() -> None:
    # Mode b is worse by one pick in every bin, however hard the bin: the interval of the difference has no width.
    a = [bin_of("a", 0, *[PickOutcome.SUCCESS] * 4), bin_of("a", 1, *[PickOutcome.SUCCESS] * 2, MISSED, MISSED)]
    b = [bin_of("b", 0, *[PickOutcome.SUCCESS] * 3, MISSED), bin_of("b", 1, PickOutcome.SUCCESS, *[MISSED] * 3)]
    (difference,) = compare_modes([*a, *b], ["a", "b"], rng()).differences
    success = difference.measures["grasp_success"]
    assert (difference.mode, difference.against) == ("b", "a")
    assert (success.value, success.low, success.high) == pytest.approx((-25, -25, -25))


def test_each_mode_is_compared_with_the_first_and_with_its_predecessor() -> None:
    results = [bin_of(mode, 0, PickOutcome.SUCCESS) for mode in "abcd"]
    pairs = [(d.mode, d.against) for d in compare_modes(results, list("abcd"), rng()).differences]
    assert pairs == [("b", "a"), ("c", "a"), ("d", "a"), ("c", "b"), ("d", "c")]


def test_only_bins_that_all_finished_without_a_fault_count() -> None:
    whole = [bin_of(mode, 0, PickOutcome.SUCCESS) for mode in "ab"]
    half = [bin_of("a", 1, MISSED)]
    fault = PickOutcome.SIMULATION_FAULT
    spoilt = [bin_of("a", 2, MISSED), bin_of("b", 2, fault, ended="simulation_fault")]
    results = [*whole, *half, *spoilt]
    assert [r.episode for r in paired_bins(results, ["a", "b"])["a"]] == [0]
    statistics = compare_modes(results, ["a", "b"], rng())
    assert statistics.bins == (0,) and statistics.left_out == (1, 2)
    assert statistics.measures["a"]["grasp_success"].value == 100


def test_the_same_generator_gives_the_same_intervals_and_no_bins_give_none() -> None:
    results = [bin_of("a", k, PickOutcome.SUCCESS, *[MISSED] * k) for k in range(4)]
    assert compare_modes(results, ["a"], rng()) == compare_modes(results, ["a"], rng())
    assert np.isnan(compare_modes([], ["a"], rng()).measures["a"]["grasp_success"].value)


def test_a_pick_without_a_pose_error_has_no_part_in_the_medians() -> None:
    far = dataclasses.replace(make_pick(1), pose_error=PoseError(9.0, 9.0, 0.0, -9.0, 9.0))
    unknown = dataclasses.replace(make_pick(2), pose_error=None)
    result = dataclasses.replace(make_result(0, make_pick(0), far, unknown), mode="a")
    assert compare_modes([result], ["a"], rng()).measures["a"]["rotation_deg"].value == 5.0


def test_the_best_mode_also_clears_the_bin() -> None:
    def figures(success: float, clearance: float, mpph: float) -> dict[str, Interval]:
        given = {"grasp_success": success, "clearance": clearance, "mpph": mpph}
        return {m.key: Interval(given.get(m.key, 0.0), 0.0, 0.0) for m in MEASURES}

    measures = {
        "shy": figures(100, 30, 900),
        "slow": figures(90, 80, 100),
        "quick": figures(90, 80, 200),
        "idle": figures(float("nan"), 0, 0),
    }
    statistics = PairedStatistics(tuple(measures), (0,), (), measures, ())
    assert best_mode(statistics, ("idle", "shy", "slow", "quick")) == "quick"
    assert best_mode(statistics, ("idle", "shy")) == "shy"
