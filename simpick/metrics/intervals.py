"""95 % confidence intervals: Wilson's for a share, the percentile bootstrap over bins for everything else.

`scipy.stats` is the test oracle of both. Its ``binomtest(...).proportion_ci("wilson")`` takes 100 times as long, since
it computes a p-value first. Its ``bootstrap`` resamples one statistic per call with its own draws: the published
intervals would change, and the figures of paired modes would no longer share one set of resampled bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Interval:
    """A value with its 95 % interval; bounds are NaN where there is nothing to estimate them from."""

    value: float
    low: float
    high: float

    @property
    def is_known(self) -> bool:
        """Return whether there are bounds; one bin has none."""
        return not (np.isnan(self.low) or np.isnan(self.high))

    @property
    def excludes_zero(self) -> bool:
        """Return whether zero lies outside; for a difference, whether it is significant.

        A zero-width interval is never significant: all bins gave the same value.
        """
        return not self.has_zero_width and (self.low > 0 or self.high < 0)

    @property
    def has_zero_width(self) -> bool:
        """Return whether both bounds are equal: the bins did not differ, so resampling them yields no spread."""
        return self.high - self.low <= 1e-9 * max(1.0, abs(self.value))


def wilson_interval(share: float, count: int, z: float = 1.96) -> tuple[float, float]:
    """Return Wilson's score interval of a share observed in `count` trials (95 % by default)."""
    if count == 0:
        return 0.0, 1.0
    centre = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z / (1 + z**2 / count) * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def resample_bins(bins: int, resamples: int, rng: np.random.Generator) -> Int[np.ndarray, "resamples bins"]:
    """Return how often each bin is drawn in each resample of the same size, with replacement.

    One bin, or none, gives no resamples: nothing can vary, so `percentile_interval` has no bounds.
    """
    if bins < 2:
        return np.zeros((0, bins), int)
    return rng.multinomial(bins, np.full(bins, 1 / bins), size=resamples)


def percentile_interval(value: float, replicates: Float[np.ndarray, "resamples"]) -> Interval:
    """Return the value with the middle 95 % of its bootstrap replicates (Efron's percentile interval).

    Resamples in which the value does not exist, for example for lack of attempts, are left out.
    """
    known = replicates[np.isfinite(replicates)]
    if not np.isfinite(value) or not len(known):
        return Interval(value, float("nan"), float("nan"))
    low, high = np.percentile(known, [2.5, 97.5])
    return Interval(value, float(low), float(high))


def resampled_ratio(
    counts: Int[np.ndarray, "resamples bins"],
    numerator: Float[np.ndarray, "bins"],
    denominator: Float[np.ndarray, "bins"],
) -> Float[np.ndarray, "resamples"]:
    """Return, for each resample, the sum of numerators over the sum of denominators; NaN where that sum is zero."""
    below = counts @ denominator
    return np.where(below > 0, counts @ numerator / np.where(below > 0, below, 1.0), np.nan)


def resampled_median(
    counts: Int[np.ndarray, "resamples bins"], values: Float[np.ndarray, "n"], bin_of: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "resamples"]:
    """Return, for each resample, the median of the values in its bins, each as often as its bin was drawn."""
    if not len(values):
        return np.full(len(counts), np.nan)
    order = np.argsort(values, kind="stable")
    ascending, upto = values[order], counts[:, bin_of[order]].cumsum(axis=1)
    total = upto[:, -1]
    # As numpy: the mean of the middle two where the number of values is even.
    lower = (upto > (total[:, None] - 1) // 2).argmax(axis=1)
    upper = (upto > total[:, None] // 2).argmax(axis=1)
    median = (ascending[lower] + ascending[upper]) / 2
    return np.where(total > 0, median, np.nan)
