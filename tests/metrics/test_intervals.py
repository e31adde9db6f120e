"""Confidence intervals against computations by hand and against SciPy."""

import numpy as np
import pytest
from scipy import stats

from simpick.metrics.intervals import (
    percentile_interval,
    resample_bins,
    resampled_median,
    resampled_ratio,
    wilson_interval,
)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_a_ratio_is_of_sums_and_not_a_mean_of_ratios() -> None:
    counts = np.array([[1, 1], [2, 0], [0, 2]])
    ratios = resampled_ratio(counts, np.array([1.0, 8.0]), np.array([2.0, 8.0]))
    assert ratios == pytest.approx([9 / 10, 1 / 2, 1.0])


def test_a_ratio_over_nothing_is_unknown() -> None:
    assert np.isnan(resampled_ratio(np.array([[2, 0]]), np.array([0.0, 1.0]), np.array([0.0, 1.0])))[0]


def test_a_resampled_median_is_that_of_the_bins_written_out() -> None:
    values, bins = np.array([5.0, 1.0, 2.0, 9.0, 4.0]), np.array([0, 0, 1, 2, 2])
    counts = resample_bins(3, 50, rng())
    for drawn, median in zip(counts, resampled_median(counts, values, bins), strict=True):
        written_out = np.concatenate([np.repeat(values[bins == b], drawn[b]) for b in range(3)])
        assert median == pytest.approx(np.median(written_out))


def test_every_resample_draws_as_many_bins() -> None:
    counts = resample_bins(7, 100, rng())
    assert (counts.sum(axis=1) == 7).all() and (counts != 1).any()


@pytest.mark.parametrize("bins", [0, 1])
def test_fewer_than_two_bins_have_no_interval(bins: int) -> None:
    counts = resample_bins(bins, 100, rng())
    interval = percentile_interval(3.0, resampled_ratio(counts, np.full(bins, 3.0), np.ones(bins)))
    assert interval.value == 3.0 and np.isnan([interval.low, interval.high]).all()
    assert not (interval.is_known or interval.excludes_zero or interval.has_zero_width)
    median = resampled_median(counts, np.array([1.0, 2.0][:bins]), np.zeros(bins, int))
    assert not percentile_interval(1.0, median).is_known


def test_the_percentile_interval_holds_the_middle_of_what_is_known() -> None:
    interval = percentile_interval(50.0, np.concatenate([np.arange(101.0), [np.nan]]))
    assert (interval.low, interval.high) == pytest.approx((2.5, 97.5))
    assert interval.excludes_zero and not percentile_interval(0.0, np.linspace(-1, 1, 9)).excludes_zero


def test_wilson_by_hand() -> None:
    # 8 of 10: centre (0.8 + 1.96^2/20) / (1 + 1.96^2/10) = 0.7168, half width 0.2266.
    assert wilson_interval(0.8, 10) == pytest.approx((0.4902, 0.9433), abs=1e-4)


def test_a_zero_width_interval_is_not_an_unknown_one() -> None:
    assert percentile_interval(1.0, np.ones(50)).has_zero_width
    assert not percentile_interval(1.0, np.array([0.0, 1.0, 2.0])).has_zero_width
    assert not percentile_interval(float("nan"), np.ones(50)).has_zero_width


@pytest.mark.parametrize(("successes", "trials"), [(0, 7), (8, 10), (10, 10), (180, 200), (1, 2000)])
def test_wilson_agrees_with_scipy(successes: int, trials: int) -> None:
    expected = stats.binomtest(successes, trials).proportion_ci(method="wilson")
    # SciPy's quantile is 1.95996, ours 1.96.
    assert wilson_interval(successes / trials, trials) == pytest.approx((expected.low, expected.high), abs=2e-5)


def test_the_bootstrap_of_a_ratio_agrees_with_scipy() -> None:
    numerator, denominator = rng().uniform(0, 10, 50), np.full(50, 10.0)
    interval = percentile_interval(0.5, resampled_ratio(resample_bins(50, 10_000, rng()), numerator, denominator))

    def ratio(above: np.ndarray, below: np.ndarray, axis: int) -> np.ndarray:
        return above.sum(axis) / below.sum(axis)

    options = {"paired": True, "vectorized": True, "method": "percentile", "n_resamples": 10_000, "rng": rng()}
    expected = stats.bootstrap((numerator, denominator), ratio, **options).confidence_interval
    assert (interval.low, interval.high) == pytest.approx((expected.low, expected.high), abs=0.01)
