"""Greedy matching by hand, and against a plain restatement of its rules."""

import numpy as np
import pytest

from simpick.errors import ConfigError
from simpick.metrics import greedy_matches, top_estimates, valid_truths


def test_the_estimate_with_the_highest_score_chooses_first_even_if_another_fits_better() -> None:
    errors = np.array([[0.10, 0.30], [0.05, 0.20]])
    matches = greedy_matches(errors, np.array([0.15, 0.25]))
    np.testing.assert_array_equal(matches, [[0, -1], [0, 1]])


def test_an_error_equal_to_the_threshold_is_too_large() -> None:
    np.testing.assert_array_equal(greedy_matches(np.array([[0.25]]), np.array([0.25, 0.26])), [[-1], [0]])


def test_each_truth_is_matched_once() -> None:
    np.testing.assert_array_equal(greedy_matches(np.array([[0.0], [0.0], [0.0]]), np.array([1.0])), [[0, -1, -1]])


def test_of_equal_errors_the_first_truth_is_taken() -> None:
    np.testing.assert_array_equal(greedy_matches(np.array([[0.1, 0.1], [0.1, 0.1]]), np.array([1.0])), [[0, 1]])


def test_an_undefined_error_matches_nothing() -> None:
    np.testing.assert_array_equal(greedy_matches(np.array([[np.nan, 0.2]]), np.array([1.0])), [[1]])


@pytest.mark.parametrize("shape", [(0, 0), (0, 3), (3, 0)])
def test_nothing_matches_nothing(shape: tuple[int, int]) -> None:
    assert (greedy_matches(np.zeros(shape), np.array([1.0])) == -1).all()


def test_random_tables_agree_with_a_plain_restatement() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        errors = rng.integers(0, 8, (rng.integers(1, 6), rng.integers(1, 6))) / 8
        thresholds = np.array([0.25, 0.5, 0.75])
        for threshold, found in zip(thresholds, greedy_matches(errors, thresholds), strict=True):
            free = dict.fromkeys(range(errors.shape[1]))
            for e in range(len(errors)):
                fitting = sorted((errors[e, g], g) for g in free if errors[e, g] < threshold)
                assert found[e] == (fitting[0][1] if fitting else -1)
                free.pop(found[e], None)


def test_the_highest_scores_count_and_ties_keep_their_order() -> None:
    np.testing.assert_array_equal(top_estimates(np.array([0.5, 0.9, 0.5, 0.7]), 3), [1, 3, 0])


def test_the_most_visible_truths_count_and_ties_keep_their_order() -> None:
    np.testing.assert_array_equal(valid_truths(np.array([0.2, 0.9, 0.2, 0.5]), 3), [0, 1, 3])


def test_a_score_that_is_no_number_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"scores of estimates must be finite, got \[nan\]"):
        top_estimates(np.array([np.nan]), 1)


def test_ties_go_to_the_earlier_in_any_number() -> None:
    # More than 16, below which an unstable sort of NumPy keeps their order.
    assert top_estimates(np.zeros(100), 60).tolist() == list(range(60))
    assert valid_truths(np.full(100, 0.5), 60).tolist() == list(range(60))
